"""What `make run` shows: a whole machine cell on mock sensors, from starting its processes to a printed table."""
