"""What semap is connected with: one file for each kind of peer (`semap_bridge/kinds`)."""
