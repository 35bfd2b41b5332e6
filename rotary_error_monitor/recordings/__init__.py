"""What is done with a recording, from files to files: replay, check, diagnosis, analysis, conversion of bags."""
