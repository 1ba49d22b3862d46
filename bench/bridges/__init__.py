"""What bridges cost, each beside a peer where there is one."""
