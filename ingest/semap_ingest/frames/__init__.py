"""Where a sensor was when it spoke: frames that move in one another, and records that wait for that."""
