"""Whole scenarios, from starting processes to a printed table: what `make run` and `make run-linuxcnc` show."""
