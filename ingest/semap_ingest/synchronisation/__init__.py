"""Records of two sensors brought together by event time."""
