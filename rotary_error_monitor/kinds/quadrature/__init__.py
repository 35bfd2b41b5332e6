"""Sine and cosine signals of encoders and interferometers: files of samples, held against a circle."""
