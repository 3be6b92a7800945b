"""The recipes that ship. `rpaug augment --recipe NAME` finds them by the name of their file."""
