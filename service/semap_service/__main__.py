"""`python -m semap_service` is `semap`."""

from semap_service.cli import main

main()
