"""Worlds: built-in ones, and SDF files as Gazebo reads them."""
