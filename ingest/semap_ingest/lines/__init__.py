"""Straight lines in the scan of a 2D laser: found by split and merge, fitted by orthogonal regression."""
