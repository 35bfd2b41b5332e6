"""Which stage a bag is of, as far as the bag, its folder, or whoever reads it says."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rotary_error_monitor.bags.metadata import read_metadata
from rotary_error_monitor.errors import InputError

STAGE_NOTE = "stage"
"""Custom data of a bag that names its stage, as `ros2 bag record --custom-data stage=A7` writes it."""


@dataclass(frozen=True)
class BagLabel:
    """What a bag says of itself: its stage, or nothing, and when it began, ns; None where it does not tell."""

    stage: str = ""
    started_ns: int | None = None


@dataclass(frozen=True)
class StageNames:
    """How stages are called of which a bag says nothing.

    Attributes:
        otherwise: name of all of them: of the description that they are read by.
        by_folder: whether the folder of a bag names its stage, whatever the bag says.
    """

    otherwise: str
    by_folder: bool = False

    def of(self, bag: str, told: str) -> str:
        """Name of the stage of a bag, by its path within the folder, that says `told` of it, or nothing."""
        above = Path(bag).parent
        if self.by_folder and above != Path():
            return above.as_posix()
        return told or self.otherwise


def label_of(bag: Path) -> BagLabel:
    """What the `metadata.yaml` of a bag says; nothing where there is none, or it cannot be read."""
    try:
        metadata = read_metadata(bag)
    except InputError:
        return BagLabel()
    return BagLabel(metadata.notes.get(STAGE_NOTE, ""), metadata.span[0] if metadata.span else None)
