"""The batch layer: what the stored states say once all of them are there, and what that changes in the log.

`smoothing`, `crossing` and `verdict` think; `recompute` reads and writes.
"""
