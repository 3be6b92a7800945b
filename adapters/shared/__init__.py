"""What several layouts read and write in the same way."""
