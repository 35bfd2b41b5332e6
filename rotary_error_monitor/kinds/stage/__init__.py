"""The rotary stage as a problem of diagnosis."""
