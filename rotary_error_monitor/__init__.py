"""Monitor, compensate and diagnose the error motion of a rotary stage and the machine that carries it."""

__version__ = "0.2.0"
