"""`python -m rpaug.cli` is the `rpaug` command."""

from rpaug.cli import main

main()
