"""A picture drawn in a process of its own is the one that is drawn here, and the process ends in any case."""

from __future__ import annotations

import io
import os
import pickle
import signal
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from rotary_error_monitor.gap.views import View
from rotary_error_monitor.report import painter as painters
from rotary_error_monitor.report.diagnosis_figure import draw
from rotary_error_monitor.report.painter import Painter
from rotary_error_monitor.report.picture import Picture

TURN = np.linspace(0.0, 2 * np.pi, 300)


def picture(causes=True, views=True):
    shown = ("/stage/lvdt/samples.radial_x", "/stage/head_a/samples.angle")
    return Picture(
        (("before", 3.0), *([("after", 1.1)] if causes else []), ("noise floor", 1.0)),
        0.95 if causes else None,
        tuple(zip(shown, (0.7, 0.3), strict=True)),
        (("unbalance", 0.9), ("mirror_flatness order_3", 0.1)),
        shown if views else (),
        tuple(View(channel, "angle, rad", TURN, np.sin(TURN), 0.1 * np.sin(TURN), "m") for channel in shown)
        if views
        else (),
    )


def pixels(png):
    from matplotlib import image

    return image.imread(io.BytesIO(png), format="png")


def ignores(pid, number):
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    mask = next(line.split()[1] for line in status.splitlines() if line.startswith("SigIgn"))
    return bool(int(mask, 16) >> (number - 1) & 1)


@pytest.mark.parametrize("wanted", [picture(), picture(causes=False), picture(causes=False, views=False)])
def test_both_processes_draw_the_same(wanted):
    with Painter() as painter:
        drawn = painter.draw(wanted)
    assert drawn.whole.startswith(b"\x89PNG") and drawn == draw(wanted)
    assert len(drawn.rows) == 1 + len(wanted.channels)


def test_the_causes_change_what_is_seen():
    with_causes, without = pixels(draw(picture()).whole), pixels(draw(picture(causes=False)).whole)
    assert with_causes.shape == without.shape
    assert not np.array_equal(with_causes, without)
    assert len(pixels(draw(picture(views=False)).whole)) < len(without)


def test_who_draws_nothing_leaves_no_process():
    with Painter() as painter:
        process = painter._process
        assert process.poll() is None
    with pytest.raises(ProcessLookupError):
        os.kill(process.pid, 0)


def test_a_picture_that_cannot_be_drawn_is_told():
    broken = Picture(
        (("before", 1.0), ("noise floor", 1.0)), None, (), (), ("head",), (View("other", "", TURN, TURN, TURN, ""),)
    )
    with Painter() as painter, pytest.raises(RuntimeError, match="drawing ended with exit code 1: ValueError"):
        painter.draw(broken)


def test_ctrl_c_is_left_to_the_diagnosis():
    with Painter() as painter:
        end = time.monotonic() + 20.0
        while not ignores(painter._process.pid, signal.SIGINT):
            assert time.monotonic() < end, "the process did not get ready"
            time.sleep(0.01)
        painter._process.send_signal(signal.SIGINT)
        assert painter.draw(picture()).whole.startswith(b"\x89PNG")


@pytest.mark.parametrize("wanted", [None, picture()])
def test_the_process_draws_what_it_is_sent(wanted, monkeypatch):
    sent = io.BytesIO(b"" if wanted is None else pickle.dumps(wanted))
    drawn = io.BytesIO()
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(sent))
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(drawn))
    monkeypatch.setattr(signal, "signal", lambda number, handler: None)
    painters.main()
    assert drawn.getvalue() == (b"" if wanted is None else pickle.dumps(draw(wanted)))
