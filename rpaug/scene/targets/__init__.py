"""Which instances an edit means: by role, by instance id, or by words."""
