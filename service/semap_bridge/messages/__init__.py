"""What messages of others say, without I/O: each format is a file, gives `Told` or raises `Unusable`."""
