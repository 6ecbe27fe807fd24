"""Inverse kinematics, groups of joints and plans without collisions."""
