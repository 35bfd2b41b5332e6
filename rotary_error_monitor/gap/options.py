"""What is taken where a user chooses nothing else."""

FALSE_ALARMS = 0.01
"""Largest chance that anything at all is found in a recording without a gap."""

MOST_CAUSES = 2
"""Effects that are combined at most: three freely chosen ones resemble too much."""
