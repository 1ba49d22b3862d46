"""How well it works: recordings whose truth is known, and what is made of them."""
