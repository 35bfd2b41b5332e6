"""What is done with recordings, from files to files: replay, check, diagnosis, analysis, trend, conversion."""
