"""Sine and cosine signals as a problem of diagnosis."""
