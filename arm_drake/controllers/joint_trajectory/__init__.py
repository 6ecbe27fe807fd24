"""The joint_trajectory_controller: its parameters, state, goals and ticks."""
