"""Draws in a process of its own: the drawing library takes as long to load as a diagnosis takes, so both go on."""

from __future__ import annotations

import pickle
import signal
import subprocess
import sys
from typing import TYPE_CHECKING

from rotary_error_monitor.start import end_without_collecting

if TYPE_CHECKING:  # arrays load a tenth of a second, and this process shall start before anything else does
    from rotary_error_monitor.report.drawn import Sheet
    from rotary_error_monitor.report.picture import Picture


class Painter:
    """Process that loads the drawing library while something else is computed, then draws one picture and ends."""

    def __init__(self) -> None:
        """Start the process."""
        self._process = subprocess.Popen(
            [sys.executable, "-m", __name__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )

    def draw(self, picture: Picture) -> Sheet:
        """A picture as PNGs; the process draws only one.

        Raises:
            RuntimeError: the process ended without a picture.
        """
        drawn, complaint = self._process.communicate(pickle.dumps(picture))
        if self._process.returncode != 0:
            last = complaint.decode(errors="replace").strip().splitlines()[-1:]
            raise RuntimeError(": ".join([f"drawing ended with exit code {self._process.returncode}", *last]))
        sheet: Sheet = pickle.loads(drawn)  # from the process that this one started
        return sheet

    def __enter__(self) -> Painter:
        """Draw within this."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the process, whether it has drawn or not."""
        self._process.kill()
        self._process.communicate()


def main() -> None:
    """Load the drawing library, wait for a picture on the standard input, write its PNGs to the standard output."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the diagnosis, which ends this process
    from rotary_error_monitor.report.diagnosis_figure import draw

    waiting = sys.stdin.buffer.read()
    if waiting:  # none where the diagnosis was ended
        sys.stdout.buffer.write(pickle.dumps(draw(pickle.loads(waiting))))  # from the process that started this one
    end_without_collecting()


if __name__ == "__main__":
    main()
