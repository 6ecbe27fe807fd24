"""What robots do with things: pick, place, and follow by sight."""
