"""The two-axis mount as a problem of diagnosis."""
