"""A line on the terminal that says how far a long recording is: share, samples a second, time left."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from rotary_error_monitor.recordings.progress import Progress, Step, silent

_SIZE = os.terminal_size((80, 24))
"""Of a terminal that does not tell its own."""

_FORM = "{desc}: |{bar:20}| {percentage:.0f} %{postfix}, {remaining} left"


def progress_bar(command: str) -> Progress:
    """Progress of a command on standard error; of none where that is no terminal."""
    if not sys.stderr.isatty():
        return silent

    @contextmanager
    def step(name: str) -> Iterator[Step]:
        from tqdm import tqdm

        begun = time.monotonic()
        size = os.get_terminal_size(sys.stderr.fileno())
        columns, lines = size.columns or _SIZE.columns, size.lines or _SIZE.lines
        with tqdm(
            total=1.0,
            desc=f"{command}, {name}",
            bar_format=_FORM,
            leave=False,
            file=sys.stderr,
            ncols=columns,
            nrows=lines,
        ) as bar:

            def tell(share: float, samples: int) -> None:
                rate = samples / max(time.monotonic() - begun, 1e-3)
                if samples:
                    bar.set_postfix_str(f"{rate:,.0f} samples/s", refresh=False)
                bar.update(share - bar.n)

            yield tell

    return step
