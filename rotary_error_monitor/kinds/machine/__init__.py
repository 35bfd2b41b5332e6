"""The five-axis machine as a problem of diagnosis."""
