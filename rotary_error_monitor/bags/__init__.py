"""Reading and writing rosbag2 bags."""
