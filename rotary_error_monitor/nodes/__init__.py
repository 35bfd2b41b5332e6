"""ROS nodes: convert, call the core, publish. The only room that imports rclpy beside `testing`."""
