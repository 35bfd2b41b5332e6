"""What a reproduction consists of: steps by commands, rows of paper and result, figures; and who carries it out."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.report.drawn import Drawn

_LONGEST = 600.0
"""Time (s) that no command of a reproduction takes on a computer that works: the longest take some 20 s."""


@dataclass(frozen=True)
class PaperComparison:
    """A number of the paper beside the one of this run.

    Attributes:
        quantity: what it is, with the place in the paper.
        paper: the paper's value; "no value" where it prints none.
        ours: that of this run.
        why: why they differ, or why they cannot.
        holds: whether ours keeps what the paper states; None where the paper states nothing that can be kept.
    """

    quantity: str
    paper: str
    ours: str
    why: str
    holds: bool | None = None


@dataclass(frozen=True)
class ProcedureStep:
    """A step of the procedure.

    Attributes:
        title: what is done.
        source: section, equations and figures of the paper.
        command: as a user types it in the folder of the results; empty for what only the simulation does.
        said: what the command printed.
        figures: the paper's figures that show its result, from this run.
        about: what was simulated for it, in words.
    """

    title: str
    source: str
    command: str = ""
    said: str = ""
    figures: tuple[Drawn, ...] = ()
    about: str = ""


@dataclass(frozen=True)
class Reproduction:
    """A paper's procedure, carried out.

    Attributes:
        name: by which the command knows it, such as `lou2019`.
        paper: authors, title, journal, year.
        simulated: what is simulated, and by what.
        steps: in the order of the paper.
        rows: paper and result side by side.
    """

    name: str
    paper: str
    simulated: str
    steps: tuple[ProcedureStep, ...]
    rows: tuple[PaperComparison, ...]

    @property
    def kept(self) -> bool:
        """Whether each statement of the paper that can be kept is."""
        return all(row.holds is not False for row in self.rows)


@dataclass(frozen=True)
class Bench:
    """Where a procedure is carried out.

    Attributes:
        folder: of measurements and results; commands run in it.
        tell: is told each step as it begins.
    """

    folder: Path
    tell: Callable[[str], None] = field(default=lambda line: None)

    def path(self, name: str) -> Path:
        """A file or bag of the folder."""
        return self.folder / name

    def picture(self, name: str, alt: str) -> Drawn:
        """A picture that a command drew; `alt` says what it shows."""
        return Drawn(self.path(name).read_bytes(), alt)

    def run(self, *arguments: str, accepted: Sequence[int] = (0,)) -> tuple[str, str]:
        """Run `rotary_error_monitor` with these arguments, as a user does; give what was typed and what it printed.

        Raises:
            InputError: it ended with another exit code than those accepted.
        """
        typed = f"rotary_error_monitor {shlex.join(arguments)}"
        self.tell(f"$ {typed}")
        done = subprocess.run(
            [sys.executable, "-m", "rotary_error_monitor.cli", *arguments],
            cwd=self.folder,
            env={**os.environ, "COLUMNS": "120"},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=_LONGEST,
        )
        if done.returncode not in accepted:
            raise InputError(f"{typed}: exit code {done.returncode}, expected {accepted[0]}: {done.stdout.strip()}")
        return typed, done.stdout
