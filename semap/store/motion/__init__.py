"""What moves and changes: tracks and their states, states of objects, a map now and at a moment."""
