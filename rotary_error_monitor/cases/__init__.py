"""Cases for the blind check: faults drawn into the true world, departures of them, what a shop floor adds."""
