"""How long a recording that is larger than memory takes, and how much memory. Figures are printed, none is a bound."""

from __future__ import annotations

import os
import shutil
import time

import pytest
from peak_memory import measured

from .long_bag import write_long_bag

GIGABYTES = float(os.environ.get("BENCH_GIGABYTES", "5"))
RATE = float(os.environ.get("BENCH_RATE", "10000"))
"""Samples a second of each instrument: at 10 kHz a gigabyte is a quarter of an hour."""


def test_a_recording_of_gigabytes(tmp_path):
    needed = 2.5 * GIGABYTES * 1e9
    if shutil.disk_usage(tmp_path).free < needed:
        pytest.skip(f"less than {needed / 1e9:.0f} GB free in {tmp_path}; set BENCH_GIGABYTES or --basetemp")
    bag = tmp_path / "bag"
    begin = time.monotonic()
    seconds = write_long_bag(bag, GIGABYTES * 1e9, rate=RATE, block_ns=50_000_000, repeated=True)
    print(f"\n{GIGABYTES:g} GB, {seconds:.0f} s of samples at {RATE:.0f} Hz, made in {time.monotonic() - begin:.0f} s")
    for command, output in (("replay", "out.npz"), ("analyse", "page.html")):
        begin = time.monotonic()
        found = measured([command, bag, "-o", tmp_path / output])
        took = time.monotonic() - begin
        print(
            f"  {command:8} {took:6.0f} s ({seconds / took:.0f} times as fast as it was recorded), {found.peak:.0f} MB"
        )
        (tmp_path / output).unlink()
