"""Faults injected, what is done about them, and the catalogue that is made of it."""
