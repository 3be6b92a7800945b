"""How far edits are from what a true change looks like, measured on the twin."""
