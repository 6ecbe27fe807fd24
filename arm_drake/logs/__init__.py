"""What a rollout is on the disk: NumPy's arrays, a table, a bag of ROS 2 messages."""
