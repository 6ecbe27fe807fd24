"""Manipulation of things: pick, place, and visual servoing."""
