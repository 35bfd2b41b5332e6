"""Faults put into a running cell: real processes over real DDS, what they publish held against what is true."""
