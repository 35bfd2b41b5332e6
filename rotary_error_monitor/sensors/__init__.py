"""Sensors of a stage: one class a kind says what it shows of the rotor, with what noise, in which fields and unit."""
