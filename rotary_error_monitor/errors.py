"""The errors that a user can mend."""

from __future__ import annotations


class InputError(ValueError):
    """Something that was given to the package is wrong; the message names the value, its origin and what would be right."""
