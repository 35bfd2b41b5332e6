"""Recordings of any length: the same numbers whatever is looked at at once, bounded memory, and nothing left behind."""

from __future__ import annotations

import errno
import json
import os
import pty
import re
import resource
import signal
import subprocess
import sys
import time
from dataclasses import fields, replace

import numpy as np
import pytest
from mock_bags import STREAMS, write_mock_bag, write_stage_bag
from peak_memory import measured
from pushed_inputs import push_block

from rotary_error_monitor.bags.kept_rows import RowsOnDisk, kept_in
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.cli import main
from rotary_error_monitor.codec.error_motion_blocks import block_from_error_motion
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.description.topics import samples_topic
from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.metrology import turns
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.recordings.kept_samples import MOST_POINTS, Distances, KeptCourse, largest_of, mean_of
from rotary_error_monitor.recordings.motion_rows import ByTick
from rotary_error_monitor.recordings.replay import replay_bag, replay_long
from rotary_error_monitor.recordings.replayed import LongReplay
from rotary_error_monitor.signals import rows
from rotary_error_monitor.signals.rows import RowsInMemory, place_of

SECONDS = 16
MEBIBYTE = 1 << 20


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """Both ways, at one speed."""
    return write_stage_bag(tmp_path_factory.mktemp("recorded") / "bag", SECONDS, seed=11)


@pytest.fixture(scope="module")
def estimated(bag):
    """Error motion of the estimator alone, which is handed all samples in the order of their stamps."""
    names = {samples_topic(stream): stream for stream in STREAMS}
    estimator, found = Estimator(load_stage()), []
    for topic, content in BagReader(bag).replay(list(names)):
        if names[topic] in estimator.inputs:
            found += push_block(estimator, names[topic], content)
    return found + estimator.finish()


@pytest.mark.parametrize("part", [977, 1 << 15])
def test_estimates_are_those_of_the_estimator_to_the_last_bit(bag, estimated, part, tmp_path, monkeypatch):
    monkeypatch.setattr(rows, "PART", part)
    out = tmp_path / "out.npz"
    assert main(["replay", str(bag), "-o", str(out)]) == 0
    motion = ErrorMotion.joined(estimated)
    assert len(motion.times_ns) > 900 * SECONDS
    with np.load(out) as found:
        for name in ("theta", "streams", "doubts"):
            assert found[name].tobytes() == getattr(motion, name).tobytes(), name
        assert np.array_equal(found["stamp_ns"], motion.times_ns)
        seen = motion.observable
        both = seen[:, :, None] & seen[:, None, :]
        for name, told, values in (("error_motion", seen, motion.components), ("covariance", both, motion.covariance)):
            assert found[name][told].tobytes() == values[told].tobytes(), name
            assert np.isnan(found[name][~told]).all(), name
    assert [path.name for path in tmp_path.iterdir()] == ["out.npz"]


def test_radial_error_motion_at_heights_is_that_of_a_replay_at_once(bag, tmp_path, monkeypatch):
    replay_bag(bag, load_stage()).save(tmp_path / "whole.npz", (0.0, 0.06))
    monkeypatch.setattr(rows, "PART", 977)
    assert main(["replay", str(bag), "--height", "0", "60", "-o", str(tmp_path / "parts.npz")]) == 0
    with np.load(tmp_path / "whole.npz") as whole, np.load(tmp_path / "parts.npz") as parts:
        assert set(parts.files) == set(whole.files) and np.isfinite(whole["radial"]).any()
        for name in whole.files:
            assert parts[name].tobytes() == whole[name].tobytes(), name


def test_tool_offsets_and_corrections_are_those_of_a_replay_at_once(tmp_path, monkeypatch):
    bag, machine = write_mock_bag(tmp_path / "bag", 8_000), load_machine("xyzac_trt")
    whole = replay_bag(bag, load_stage(), machine)
    monkeypatch.setattr(rows, "PART", 613)
    assert main(["replay", str(bag), "--machine", "xyzac_trt", "-o", str(tmp_path / "out.npz")]) == 0
    assert np.isfinite(whole.tool_offset).any() and np.isnan(whole.tool_offset).any()
    with np.load(tmp_path / "out.npz") as found:
        assert found["tool_offset"].tobytes() == whole.tool_offset.tobytes()
        assert found["corrections"].tobytes() == np.array([each.values for each in whole.corrections]).tobytes()
        assert np.array_equal(found["correction_stamp_ns"], [each.stamp_ns for each in whole.corrections])


def test_what_was_published_live_is_repeated_from_its_parts(bag, estimated, tmp_path, monkeypatch):
    wire, live, first = load_wire(), tmp_path / "live", replay_long(bag, load_stage())
    topic = wire.topic("error_motion_samples")
    blocks = [block_from_error_motion(each, topic.columns) for each in estimated]
    contents = {**BagReader(bag).read_blocks(), topic.name: blocks}
    write_messages(live, contents, wire)
    monkeypatch.setattr(rows, "PART", 501)
    again = replay_long(live, load_stage(), keep=kept_in(tmp_path))
    assert again.repeated and not first.repeated and again.is_complete
    one, other = (each.part(0, len(each)) for each in (first, again))
    assert len(one) == len(other)
    for each in fields(ErrorMotion):
        assert getattr(one.motion, each.name).tobytes() == getattr(other.motion, each.name).tobytes(), each.name


def analysed(bag, out):
    assert main(["analyse", str(bag), "--height", "0", "60", "--format", "json", "-o", str(out)]) == 0
    return json.loads(out.read_text(encoding="utf-8"))


def test_figures_do_not_depend_on_the_parts(bag, tmp_path, monkeypatch):
    """To rounding: with as many rows at once as the recording has, a whole run is cut at once."""
    whole = analysed(bag, tmp_path / "whole.json")
    monkeypatch.setattr(rows, "PART", 311)
    monkeypatch.setattr(turns, "_MOST_VALUES", 1_500)
    parts = analysed(bag, tmp_path / "parts.json")
    assert len(whole["figures"]) > 60
    for one, other in zip(whole["figures"], parts["figures"], strict=True):
        assert (one["name"], one["segment"], one["turns"]) == (other["name"], other["segment"], other["turns"])
        assert other["value"] == pytest.approx(one["value"], rel=1e-9, abs=1e-18)
        if one["expanded_uncertainty"] is not None:
            assert other["expanded_uncertainty"] == pytest.approx(one["expanded_uncertainty"], rel=1e-9)
    for key in ("segments", "streams", "fallen_out", "remarks", "positioning_remarks", "verdict"):
        assert parts[key] == whole[key]


@pytest.mark.parametrize(
    ("unrepeated", "lost", "complete"), [([], [], True), ([], [5], False), ([-7], [], True), ([0], [], False)]
)
def test_parts_are_read_only_where_a_tick_could_not_be_repeated(unrepeated, lost, complete, bag, monkeypatch):
    """Ticks that could not be repeated are missed where they are among those that are given."""
    found = replay_long(bag, load_stage())
    first_ns, read = found.span_ns[0], []
    ticks = [np.array(each, np.int64) + first_ns for each in (unrepeated, lost)]
    found = replace(found, unrepeated_ns=ticks[0], lost_ns=ticks[1])
    parts = LongReplay.parts
    monkeypatch.setattr(LongReplay, "parts", lambda replay: read.append(replay) or parts(replay))
    assert found.is_complete == complete
    assert len(read) == len(unrepeated)


@pytest.mark.parametrize("seed", range(5))
def test_the_last_word_on_a_tick_counts_in_whatever_order_they_come(seed, monkeypatch):
    monkeypatch.setattr(rows, "PART", 7)
    rng = np.random.default_rng(seed)
    found, known = ByTick(RowsInMemory, 1, lambda tick, said: (tick, said[0])), {}
    for _ in range(40):
        begin = int(rng.integers(0, 400))
        ticks = begin + np.arange(int(rng.integers(1, 30))) * int(rng.integers(1, 4))
        said = rng.normal(size=(len(ticks), 1))
        found.add(ticks, said)
        known |= {tick: (tick, number) for tick, (number,) in zip(ticks.tolist(), said.tolist(), strict=True)}
    assert len(found) == len(known) and list(found) == sorted(known)
    for tick in rng.permutation(500).tolist():
        assert found.get(tick) == known.get(tick)


@pytest.mark.parametrize("seed", range(5))
def test_rows_on_the_disk_are_those_that_were_put_there(seed, tmp_path, monkeypatch):
    monkeypatch.setattr("rotary_error_monitor.bags.kept_rows._MOST_WAITING", 2_000)
    rng = np.random.default_rng(seed)
    kept, known = RowsOnDisk((3,), np.int64, tmp_path), np.empty((0, 3), np.int64)
    for _ in range(50):
        new = np.cumsum(rng.integers(0, 3, (int(rng.integers(0, 60)), 3)), axis=0) + known.max(initial=0)
        kept.append(new)
        known = np.concatenate([known, new])
        first, last = sorted(rng.integers(0, len(known) + 5, 2).tolist())
        assert np.array_equal(kept.read(first, last), known[first:last])
    assert not list(tmp_path.iterdir())  # the file has no name
    monkeypatch.setattr(rows, "PART", 5)
    times = RowsOnDisk((), np.int64, tmp_path)
    times.append(known[:, 0])
    for value in rng.integers(-1, known.max() + 2, 50).tolist():
        assert place_of(times, value) == np.searchsorted(known[:, 0], value)


@pytest.mark.parametrize("seed", range(5))
def test_rate_and_jitter_are_those_of_all_distances(seed, monkeypatch):
    rng = np.random.default_rng(seed)
    times = np.sort(np.arange(50_000) * 1_000_000 + rng.normal(0, 2_000, 50_000).astype(np.int64))
    times = times[rng.random(50_000) > 0.01]
    steps = np.diff(times) * 1e-9
    regular = steps[np.abs(steps - np.median(steps)) < 0.5 * np.median(steps)]
    for most, told in ((1 << 20, 1e-9), (1_000, 1e-3)):  # of few that are told apart, to their rounding
        monkeypatch.setattr("rotary_error_monitor.recordings.kept_samples.MOST_DISTANCES", most)
        found = Distances()
        for part in np.array_split(np.diff(times), 20):
            found.add(part)
        rate, jitter = found.rate_and_jitter()
        assert rate == pytest.approx(1 / regular.mean(), rel=told)
        assert jitter == pytest.approx(regular.std() / np.sqrt(2), rel=max(told, 1e-8) * 10)


@pytest.mark.parametrize("seed", range(5))
def test_a_long_course_keeps_its_largest_value_and_its_mean(seed):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(3 * MOST_POINTS, 6 * MOST_POINTS))
    times, values = np.arange(count) * 1_000_000, np.cumsum(rng.normal(size=count))
    peaks, means = KeptCourse(largest_of), KeptCourse(mean_of)
    begin = 0
    while begin < count:
        end = begin + int(rng.integers(1, 5_000))
        for course in (peaks, means):
            course.add(times[begin:end], values[begin:end])
        begin = end
    found = peaks.samples
    assert len(found.times_ns) <= MOST_POINTS + 1 and (np.diff(found.times_ns) > 0).all()
    assert found.values.max() == values.max() and found.times_ns[np.argmax(found.values)] == times[np.argmax(values)]
    slow = means.samples
    at = rng.integers(0, count, 1_000)
    assert np.abs(np.interp(times[at], slow.times_ns, slow.values) - values[at]).max() < 40  # the walk within 16 steps


@pytest.fixture(scope="module")
def lengths(tmp_path_factory):
    """A bag, and one that is four times as long."""
    folder = tmp_path_factory.mktemp("lengths")
    return [write_stage_bag(folder / f"bag_{times}", 12 * times) for times in (1, 4)]


@pytest.mark.parametrize(("command", "output"), [("replay", "out.npz"), ("analyse", "page.json")])
def test_memory_does_not_grow_with_the_recording(lengths, command, output, tmp_path):
    """Of what is kept, 36 s of estimates and samples are 12 MB, with the covariances as matrices 20 MB."""
    short, long = (measured([command, bag, "-o", tmp_path / output], part=4_096, steady=True) for bag in lengths)
    assert (short.code, long.code) == (0, 0)
    assert long.peak - short.peak < 12


def limited(arguments, most):
    """A command that can write files of so many bytes at most, as on a disk that is full."""
    return subprocess.run(
        [sys.executable, "-m", "rotary_error_monitor.cli", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most, most)),
    )


@pytest.mark.parametrize(("command", "most"), [("replay", 5 * MEBIBYTE // 4), ("replay", 3 * MEBIBYTE)])
def test_a_full_disk_is_told_and_what_stood_there_stays(bag, command, most, tmp_path):
    """Full while ticks are kept, and while the result is written."""
    out = tmp_path / "out.npz"
    out.write_bytes(b"old")
    done = limited([command, bag, "-o", out], most)
    assert done.returncode == 2, done.stderr
    assert os.strerror(errno.EFBIG) in done.stderr and "Traceback" not in done.stderr
    assert (out.read_bytes(), [path.name for path in tmp_path.iterdir()]) == (b"old", ["out.npz"])


def test_ctrl_c_ends_what_a_terminal_shows_and_leaves_nothing_behind(lengths, tmp_path):
    """A real signal while the line on the terminal says how far it is."""
    out = tmp_path / "page.html"
    out.write_text("old", encoding="utf-8")
    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "rotary_error_monitor.cli", "analyse", str(lengths[1]), "-o", str(out)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=theirs)
    os.close(theirs)
    shown, until = "", time.monotonic() + 120
    told = r"analyse, estimates: .* \d+ %, [\d,]+ samples/s, \S+ left"
    while not re.search(told, shown) and time.monotonic() < until:
        shown += os.read(ours, 4096).decode(errors="replace")
    assert re.search(told, shown), shown
    process.send_signal(signal.SIGINT)
    printed, _ = process.communicate(timeout=60)
    os.close(ours)
    assert (process.returncode, printed) == (130, b"")
    assert (out.read_text(encoding="utf-8"), [path.name for path in tmp_path.iterdir()]) == ("old", ["page.html"])
