"""`python -m rpaug` is the `rpaug` command."""

from rpaug.cli import main

main()
