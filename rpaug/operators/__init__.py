"""The edits: one operator a file, each found through its entry point."""
