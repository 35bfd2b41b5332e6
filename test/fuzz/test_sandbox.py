"""The sandbox catches what it is there for, and goes on after it."""

from __future__ import annotations

import signal

import pytest

from .sandbox import Sandbox


@pytest.mark.parametrize(
    ("how", "code", "ended", "fault"),
    [
        ("loop", None, signal.SIGXCPU, "ended by signal 24 after"),
        ("crash", None, signal.SIGSEGV, "ended by signal 11 after"),
        ("grow", 1, None, "prints Traceback"),
        ("raise", 1, None, "prints Traceback"),
        ("warn", 2, None, "prints a warning"),
        ("chatter", 2, None, "says 100023 characters"),
        ("nothing", 2, None, "says nothing"),
    ],
)
def test_what_is_no_clean_end_is_told(sandbox: Sandbox, how: str, code: int, ended: int, fault: str) -> None:
    found = sandbox.run(["misbehave", how], cpu=1)
    assert (found.code, found.signal) == (code, ended)
    assert found.fault is not None and found.fault.startswith(fault) and how in str(found)
    after = sandbox.run(["wire"])
    assert after.code == 0 and after.fault is None and "/stage/head_{head}/samples" in after.said
