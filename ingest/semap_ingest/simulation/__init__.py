"""A made-up office and a robot in it: recordings whose truth is known."""
