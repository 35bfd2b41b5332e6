"""Where samples come from: one small class a device. Nothing here knows ROS; a new device is one more class."""
