"""Events sent to web addresses: at least once, in their order for each webhook, signed.

`delivery` is the only part with I/O of its own; what it decides is pure (`retry`, `signature`, `address`).
"""
