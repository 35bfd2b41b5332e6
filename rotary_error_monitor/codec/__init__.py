"""Messages as CDR bytes: standard types, read and written without ROS."""
