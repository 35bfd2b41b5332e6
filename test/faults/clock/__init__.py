"""Faults of the clock, in a running cell on simulated time."""
