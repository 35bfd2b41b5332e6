"""`rotary_error_monitor effects`: what a diagnosis can name, as tables."""

from __future__ import annotations

import argparse

from rotary_error_monitor.commands.values import add_effect_files
from rotary_error_monitor.errors import InputError


def add(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.add_argument(
        "section", nargs="?", help="only those of one kind of thing, by the section of its twin, such as stage"
    )
    add_effect_files(parser)


def run(arguments: argparse.Namespace) -> int:
    """Print a table for each kind of thing."""
    from rotary_error_monitor.effects.library import load_effects
    from rotary_error_monitor.gap.effect_table import effect_table
    from rotary_error_monitor.gap.loading import known_kinds

    kinds = known_kinds()
    if arguments.section not in (None, *kinds):
        raise InputError(f"section is '{arguments.section}'; expected one of {', '.join(kinds)}")
    tables = [
        f"## Effects of a {name}\n\n{effect_table(load_effects(kind.effect, arguments.effects))}"
        for name, kind in kinds.items()
        if arguments.section in (None, name)
    ]
    print("\n".join(tables), end="")
    return 0
