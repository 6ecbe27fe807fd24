"""Pictures, films and pages of robots, plans and rollouts."""
