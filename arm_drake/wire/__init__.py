"""ROS 2 on the wire: topics, services and actions for programs of other people."""
