"""Rollouts, their comparison, and the files that they are in."""
