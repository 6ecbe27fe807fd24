"""ROS 2 robot packages, unchanged, as Drake diagrams."""
