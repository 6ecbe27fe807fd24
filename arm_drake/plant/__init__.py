"""Robots in Drake's plant: models, poses, kinematics, contact, sensors."""
