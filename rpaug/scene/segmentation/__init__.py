"""Instances from motion, for episodes that were recorded without masks."""
