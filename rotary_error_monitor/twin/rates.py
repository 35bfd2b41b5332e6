"""How many samples of a sensor are used."""

MOST_RATE = 1000.0
"""Samples a second of one sensor that are used by default: a rotor is slower than that, and all of 50,000 would take
gigabytes."""

LEAST_RATE = 100.0
"""Samples a second of a sensor below which the jitter of a rotor cannot be told from noise."""
