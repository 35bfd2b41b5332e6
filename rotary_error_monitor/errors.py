"""The errors that a user can mend."""

from __future__ import annotations


class InputError(ValueError):
    """Wrong input; the message names the value, where it came from and what would be right."""


def excerpt(text: object, most: int = 200) -> str:
    """The text for a message: of one that is longer than `most` characters its beginning and its end."""
    shown = str(text)
    if len(shown) <= most:
        return shown
    half = most // 2
    return f"{shown[:half]} … {shown[-half:]}"
