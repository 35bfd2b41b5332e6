"""What is done with a recording, from files to files: replay, check of the description, diagnosis, analysis."""
