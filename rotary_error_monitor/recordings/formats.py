"""Files that the results of an analysis are written to, by the formats that there are."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from rotary_error_monitor.errors import InputError, excerpt

FORMATS = ("html", "json", "csv", "png")


def outputs_of(output: Path, formats: str = "") -> Mapping[str, Path]:
    """File of each format of a list such as `html,json`, all by the name of `output`; by default the one it ends in.

    Raises:
        InputError: the list has a format that there is not, or without a list `output` ends in none.
    """
    chosen = [each.strip() for each in formats.split(",")] if formats else [output.suffix.removeprefix(".")]
    wrong = [each for each in chosen if each not in FORMATS]
    if wrong and formats:
        raise InputError(f"--format has '{excerpt(wrong[0])}'; give some of {','.join(FORMATS)}")
    if wrong:
        raise InputError(f"{output}: ends in none of {', '.join(FORMATS)}; name such a file, or give --format")
    if output.suffix.removeprefix(".") not in FORMATS:
        return {each: output.with_name(f"{output.name}.{each}") for each in chosen}
    return {each: output.with_suffix(f".{each}") for each in chosen}
