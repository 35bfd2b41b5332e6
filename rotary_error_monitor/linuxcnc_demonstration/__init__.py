"""What `make run-linuxcnc` shows: a five-axis program on a real controller, with and without correction."""
