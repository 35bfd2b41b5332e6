"""The errors that a user can mend."""

from __future__ import annotations


class InputError(ValueError):
    """Wrong input; the message names the value, where it came from and what would be right."""
