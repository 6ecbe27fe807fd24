"""Cameras of robots: pictures, scenery, and the sensors of descriptions."""
