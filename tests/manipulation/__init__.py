"""Tests of what robots do with things."""
