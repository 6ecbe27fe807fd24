"""joint_trajectory."""
