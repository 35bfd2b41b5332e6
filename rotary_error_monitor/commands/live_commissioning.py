"""What `commission --live` does before it commissions: it looks what is there, and records while the stage turns."""

from __future__ import annotations

import argparse
import math
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from rotary_error_monitor.commissioning.stage_file import check_commissionable
from rotary_error_monitor.commissioning.travel import ENOUGH, TravelWatch, TurnedTravel
from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.description.streams import TWO_AXIS
from rotary_error_monitor.errors import InputError, one_line

if TYPE_CHECKING:
    from rotary_error_monitor.nodes.stream_recorder import LiveCell, Presence

PATIENCE = 15.0
"""Time, s, that streams have to come: discovery alone may take some seconds."""

DURATION = 600.0
"""Longest recording, s: two turns by hand take a minute or two."""

_MEASURED = 2.0
"""Time, s, over which rates are measured, once all streams are there."""

_PERIOD = 1.0
"""Time, s, from one look at how far the stage has turned to the next."""

_STRIDE = math.radians(45.0)
"""Rotation after which there is a new line where nobody watches."""

_OPTIONAL = ("force", "temperature")
"""Streams of which nothing is said where they are not there."""


def add_live(parser: argparse.ArgumentParser) -> None:
    """Describe the arguments of a running cell."""
    parser.add_argument("--namespace", default="", metavar="/NS", help="of the running cell, such as /left")
    parser.add_argument("--record", type=Path, metavar="DIR", help="folder of the recording of --live (default: dated)")
    parser.add_argument(
        "--patience", type=float, default=PATIENCE, metavar="S", help=f"time for streams to come (default {PATIENCE:g})"
    )
    parser.add_argument(
        "--duration", type=float, default=DURATION, metavar="S", help=f"longest recording (default {DURATION:g})"
    )


def record_live(arguments: argparse.Namespace) -> Path:
    """Record the raw streams of a running cell until its stage has turned both ways; give the bag.

    Raises:
        InputError: ROS is not there, the stage has no heads, a head does not come, or the recording had to stop.
    """
    for name in ("patience", "duration"):
        if not 0 < getattr(arguments, name) < math.inf:
            raise InputError(f"--{name} is {getattr(arguments, name)}; expected a time in s above 0")
    stage = load_stage(arguments.stage)
    if stage.encoder is None:
        raise InputError(f"{arguments.stage}: the stage has no section 'encoder'; expected read heads")
    check_commissionable(stage, arguments.stage)
    folder: Path = arguments.record or Path(f"commission_{datetime.now(UTC):%Y%m%d_%H%M%S}")
    try:
        from rotary_error_monitor.nodes.stream_recorder import live_cell
    except ImportError as error:
        raise InputError(
            f"--live talks to ROS 2, which is not there ({one_line(str(error))}); source its setup.bash, or give a BAG"
        ) from error
    watch = TravelWatch(stage)
    with live_cell(arguments.stage, folder, arguments.namespace, watch.note) as cell:
        print(f"listening, and recording to {folder}:", flush=True)
        print("\n".join(_look(cell, stage, arguments.patience)), flush=True)
        _wait_for_turns(cell, watch, arguments.duration)
    return folder


def _look(cell: LiveCell, stage: StageDescription, patience: float) -> Iterator[str]:
    """What is there of each stream, once all have come or the patience is over.

    Raises:
        InputError: a head does not come.
    """
    heads = [f"head_{letter}" for letter in stage.azimuths]
    absent = {*_OPTIONAL, *TWO_AXIS} - set(stage.two_axis)
    expected = [name for name in cell.raw if name not in absent]
    cell.spin(patience, lambda: all(cell.counts()[name] for name in expected))
    before, begun = cell.counts(), time.monotonic()
    cell.spin(_MEASURED)
    after, elapsed = cell.counts(), time.monotonic() - begun
    found = {name: cell.presence(name, (after[name] - before[name]) / elapsed) for name in cell.raw}
    shown = [name for name in found if name in expected or found[name].rate]
    missing = [name for name in expected if not found[name].rate]
    lines = [line for name in shown for line in _told(found[name])]
    if missing:
        lines += [f"  published, and nobody listens: {each}" for each in cell.unheard()]
        lines += [f"  another cell speaks in {each}: see --namespace" for each in cell.other_cells()]
    if lacking := [found[name].topic.name for name in missing if name in heads]:
        print("\n".join(map(one_line, lines)), flush=True)
        raise InputError(
            f"no samples on {', '.join(lacking)} within {patience:g} s; see above who publishes what, and put it right"
        )
    yield from map(one_line, lines)


def _told(found: Presence) -> Iterator[str]:
    by = ", ".join(found.publishers)
    if found.rate:
        yield f"  {found.topic.name}: {found.rate:.1f} samples/s, of {by or 'a node of unknown name'}"
    elif by:
        yield f"  {found.topic.name}: MISSING: {by} publishes it, and no sample comes"
    else:
        yield f"  {found.topic.name}: MISSING: nobody publishes it; expected {' or '.join(found.topic.publishers)}"
    yield from (f"    wrong: {each}; expected {found.topic.type}" for each in found.deaf)
    if not found.rate:
        yield from (f"    {each}" for each in found.complaints)


def _wait_for_turns(cell: LiveCell, watch: TravelWatch, duration: float) -> None:
    """Have the recording go on until the stage has turned enough, Ctrl-C comes, or the time is over."""
    print(
        f"turn the stage slowly, by hand or by its controller: {math.degrees(ENOUGH):.0f}° one way, then as far back; "
        "then let it stand (Ctrl-C ends the recording as well)",
        flush=True,
    )
    show, end = _progress(), time.monotonic() + duration
    with _interrupted() as ended:
        while not ended() and time.monotonic() < end:
            cell.spin(min(_PERIOD, end - time.monotonic()), ended)
            travel = watch.travel()
            show(travel, False)
            if travel.is_enough:
                break
    show(watch.travel(), True)


def _progress() -> Callable[[TurnedTravel, bool], None]:
    """Function that says how far the stage has turned: on a terminal in one line, else in few."""
    watched, last = sys.stdout.isatty(), [-1.0]

    def show(travel: TurnedTravel, is_last: bool) -> None:
        forth, back = (math.degrees(each) for each in (travel.forth, travel.back))
        text = f"turned {forth:.0f}° one way, {back:.0f}° the other, of {math.degrees(ENOUGH):.0f}°"
        covered = travel.forth + travel.back
        if watched:
            print(f"\r{text}   ", end="\n" if is_last else "", flush=True)
        elif is_last or covered >= last[0] + _STRIDE or last[0] < 0:
            last[0] = covered
            print(text, flush=True)

    return show


@contextmanager
def _interrupted() -> Iterator[Callable[[], bool]]:
    """Whether Ctrl-C came while in the `with` statement, in which it ends nothing by itself."""
    came = threading.Event()

    def note(number: int, frame: FrameType | None) -> None:
        came.set()

    ours = threading.current_thread() is threading.main_thread()
    before = signal.signal(signal.SIGINT, note) if ours else None
    try:
        yield came.is_set
    finally:
        if ours:
            signal.signal(signal.SIGINT, before)
