"""The controller types."""
