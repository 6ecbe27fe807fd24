"""Launch files of ROS 2, without ROS."""
