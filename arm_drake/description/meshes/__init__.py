"""Meshes of robot descriptions, converted once to what Drake draws and collides."""
