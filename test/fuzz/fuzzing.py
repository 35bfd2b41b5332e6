"""One try after another, and what came of them."""

from __future__ import annotations

import hashlib
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from .sandbox import WARNS, Run, Sandbox
from .targets import Target, place

BAGS = frozenset({"mcap", "definition", "metadata", "db3"})


@dataclass(frozen=True)
class Fault:
    """A file that did not end cleanly, the number of the command that read it, and how that ended."""

    target: Target
    command: int
    content: bytes
    run: Run

    def keep(self, corpus: Path) -> Path:
        """Write the file to the corpus: its name says the command, and has a part of the content's hash."""
        digest = hashlib.sha256(self.content).hexdigest()[:12]
        path = corpus / self.target.name / f"{self.command}_{digest}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(self.content)
        return path


@dataclass
class Fuzzer:
    """Tries changed files in the sandbox.

    Attributes:
        codes: exit codes by target.
        faults: what did not end cleanly.
        most: processor time (s) of the longest run.
    """

    sandbox: Sandbox
    folder: Path
    templates: Path
    codes: Counter[tuple[str, int | None]] = field(default_factory=Counter)
    faults: list[Fault] = field(default_factory=list)
    most: float = 0.0

    def draw(self, target: Target, seed: int) -> None:
        """Try the file and the command that belong to a seed."""
        random = Random(f"{target.name} {seed}")
        command = random.randrange(len(target.commands(self.folder)))
        self.read(target, command, target.input(random))

    def read(self, target: Target, command: int, content: bytes) -> None:
        """Try a file with one of the commands."""
        place(target, content, self.folder, self.templates)
        run = self.sandbox.run(target.commands(self.folder)[command])
        self.codes[target.name, run.code] += 1
        self.most = max(self.most, run.cpu)
        # What an estimator warns of when samples have no bounds is no matter of files.
        if run.fault is not None and not (target.name in BAGS and run.fault == WARNS):
            self.faults.append(Fault(target, command, content, run))
