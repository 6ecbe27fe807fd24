"""What robots see: cameras, and what they look at."""
