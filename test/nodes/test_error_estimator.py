"""The estimator as a node: right values, and what happens when streams fail."""

from __future__ import annotations

import os
import signal

import numpy as np
import pytest
from faults.documenting import Row, shows
from faults.live.other_programs import check, lost_time
from kernels import computing_by
from nodes.node_log import Log
from nodes.plant_samples import assert_figures
from rclpy.serialization import deserialize_message
from received_blocks import block_of
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.autocollimator import AutocollimatorNode
from rotary_error_monitor.nodes.diagnostics import status_name
from rotary_error_monitor.nodes.encoder_head import EncoderHead
from rotary_error_monitor.nodes.error_estimator import ErrorEstimator
from rotary_error_monitor.nodes.mock_controller import MockController
from rotary_error_monitor.pipeline.command_belief import CommandBelief
from rotary_error_monitor.pipeline.evidence import WINDOW_NS
from rotary_error_monitor.resources import config
from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock, block_from_samples
from rotary_error_monitor.testing.cell import PATIENCE

COMPONENTS = ("exc", "eyc", "ezc", "eac", "ebc", "ecc")
PERIOD = 0.005
SIGMAS = 6.0
PERIOD_NS = 5_000_000
RESOLUTION = load_stage().encoder.resolution


@pytest.fixture
def estimates(cell):
    return cell.collect(cell.wire.topic("error_motion_samples"))


@pytest.fixture
def sensors(cell):
    nodes = {f"head_{head}": cell.run(EncoderHead, f"encoder_head_{head}", source="mock") for head in "abcd"}
    nodes["autocollimator"] = cell.run(AutocollimatorNode, "autocollimator", source="mock")
    nodes["command"] = cell.run(MockController, "mock_controller")
    return nodes


def check_against_truth(received, plant):
    """Every component that is claimed to be observable is right, the others are zero."""
    bounds: dict[str, list[float]] = {}
    for message in received:
        block = block_of(message)
        truth = plant.scene((block.times_ns - plant.epoch_ns) * 1e-9).error_motion
        bits = block.column("observable").astype(int)
        for index, name in enumerate(COMPONENTS):
            claimed = bits >> index & 1 == 1
            found = block.column(name)
            assert (found[~claimed] == 0.0).all()
            if claimed.any():
                bound = SIGMAS * np.sqrt(block.column(f"var_{name}"))
                assert (np.abs(found - truth[:, index]) <= bound)[claimed].all(), name
                bounds.setdefault(name, []).extend(bound[claimed].tolist())
    for name, each in bounds.items():
        assert np.median(each) < 1e-4, f"an uncertainty of {name} that bounds something"
    return set(bounds)


def newest_mask(received):
    return int(block_of(received[-1]).column("streams")[-1])


def whole_ns(received):
    """Stamp (ns) of the first estimate that all streams were used for; 0 where there is none yet."""
    for block in map(block_of, received):
        whole = block.times_ns[block.column("streams") == 0b111111]
        if whole.size:
            return int(whole[0])
    return 0


def test_that_ticks_are_computed_by_numpy_is_logged(cell, capfd):
    with computing_by("numpy"):
        cell.run(ErrorEstimator, "error_estimator")
    log = capfd.readouterr().err
    assert log.count("ticks are computed by numpy, which is slower: ROTARY_ERROR_MONITOR_KERNEL=numpy") == 1


def test_all_streams_give_all_components_but_the_axial_one(cell, estimates, sensors, plant):
    poses = cell.collect(cell.wire.topic("error_motion_pose"))
    figures = cell.collect(cell.wire.topic("error_motion_figures"))
    cell.run(ErrorEstimator, "error_estimator", period=PERIOD, check_turns=0.0)
    cell.wait_for_status("error_estimator: estimate", "complete")
    count = len(figures)
    cell.wait_until(lambda: len(estimates) > 10 and len(poses) > 2 and len(figures) > count + 4, "estimates")
    assert check_against_truth(estimates[2:], plant) == {"exc", "eyc", "eac", "ebc", "ecc"}
    covariance = np.reshape(poses[-1].pose.covariance, (6, 6))
    assert covariance[2, 2] == -1.0
    assert (np.diag(covariance)[[0, 1, 3, 4, 5]] > 0).all()
    assert_figures(figures, estimates, COMPONENTS, hidden="ezc")
    cell.forget_status("error_estimator: estimate")
    cell.wait_for_status("error_estimator: estimate", "complete")
    assert float(cell.figures("error_estimator: estimate")["rate_hz"]) > 50
    cell.wait_for_status("error_estimator: /stage/head_a/samples", "alive")


def test_radial_error_motion_goes_out_at_the_heights_that_are_named(cell, sensors, plant):
    heights = [0.016, -0.06]
    received = cell.collect(cell.wire.topic("error_motion_heights_samples"))
    figures = cell.collect(cell.wire.topic("error_motion_heights_figures"))
    cell.run(ErrorEstimator, "error_estimator", period=PERIOD, check_turns=0.0, heights=heights)
    cell.wait_until(lambda: len(received) > 10 and len(figures) > 4, "radial error motion at heights")
    for message in received[2:]:
        block = block_of(message)
        height, seen = block.column("height"), block.column("observable") == 1.0
        assert height.tolist() == heights * (len(height) // 2)
        motion = plant.scene((block.times_ns - plant.epoch_ns) * 1e-9).error_motion
        truth = np.stack([motion[:, 0] + height * motion[:, 4], motion[:, 1] - height * motion[:, 3]], axis=1)
        for axis, name in enumerate("xy"):
            bound = SIGMAS * np.sqrt(block.column(f"var_{name}"))
            assert (np.abs(block.column(f"radial_{name}") - truth[:, axis]) <= bound)[seen].all()
    assert block.column("observable").any() and np.median(bound[seen]) < 1e-4
    latest = figures[-1]
    assert list(latest.name) == [f"radial_{axis}_at_{place}mm" for place in ("16", "minus_60") for axis in "xy"]
    stamped = {messages.ns_from_stamp(message.header.stamp) for message in figures}
    blocks = [block_of(message) for message in received]
    same = [block for block in blocks if int(block.times_ns[-1]) in stamped]
    assert same
    shown = {messages.ns_from_stamp(message.header.stamp): message for message in figures}[int(same[-1].times_ns[-1])]
    rows = same[-1].rows[-2:]
    assert list(shown.position) == pytest.approx(rows[:, 2:4].ravel() * 1e6, nan_ok=True)
    assert list(shown.effort) == pytest.approx(np.sqrt(rows[:, 5:7]).ravel() * 1e6, nan_ok=True)


@shows(
    Row(
        "heads",
        "Samples of the heads are further apart than `max_gap` (25 ms), as of heads at 30 Hz",
        "`error_estimator: estimate`: impossible, how far apart the samples of which heads are, and `max_gap`",
        "samples so far apart are not joined: between them the rotor may have been anywhere",
        "nothing",
        "faster heads, or a larger `max_gap` where the motion is slow",
    )
)
@pytest.mark.parametrize("rate", [30.0, 25.0])
def test_heads_that_are_slower_than_max_gap_are_named(cell, estimates, rate):
    for head in "abcd":
        cell.run(EncoderHead, f"encoder_head_{head}", rate=rate, source="mock")
    cell.run(MockController, "mock_controller")
    estimator = cell.run(ErrorEstimator, "error_estimator", period=PERIOD, check_turns=0.0)
    words = (
        f"samples of head_a, head_b, head_c, head_d are {1e3 / rate:.3g} ms apart; what is further apart than max_gap"
    )
    status = cell.wait_for_status("error_estimator: estimate", words)
    assert status.level == b"\x02"
    assert estimates == []
    cell.remove(estimator)
    estimates.clear()
    cell.run(ErrorEstimator, "error_estimator", period=PERIOD, check_turns=0.0, max_gap=0.06)
    cell.wait_until(lambda: len(estimates) > 5, "estimates with a larger max_gap")


def test_slow_streams_beside_fast_heads_are_named(cell, estimates):
    """A head, the autocollimator and the command: their part of the estimate is missing, and why is said."""
    for head in "abcd":
        cell.run(EncoderHead, f"encoder_head_{head}", rate=30.0 if head == "b" else 1000.0, source="mock")
    cell.run(AutocollimatorNode, "autocollimator", rate=25.0, source="mock")
    cell.run(MockController, "mock_controller", rate=30.0)
    cell.run(ErrorEstimator, "error_estimator", period=PERIOD, check_turns=0.0)
    cell.wait_until(lambda: len(estimates) > 5, "estimates of the other heads")
    apart = {"head_b": 33.3, "autocollimator": 40, "command": 33.3}
    limit = "what is further apart than max_gap of 25 ms is not joined"
    words = [f"samples of {name} are {gap} ms apart; {limit}" for name, gap in apart.items()]

    def all_are_named() -> bool:
        """In a warning: in the first reports some estimates may have been impossible."""
        status = cell.status("error_estimator: estimate")
        return status.level == b"\x01" and all(each in status.message for each in words)

    cell.wait_until(all_are_named, f"{words}")
    assert cell.status("error_estimator: estimate").message.count("max_gap") == len(words)
    assert newest_mask(estimates) == 0b1101


def test_heads_die_one_after_another(cell, estimates, sensors, plant):
    cell.run(ErrorEstimator, "error_estimator", period=PERIOD, check_turns=0.0)
    cell.wait_until(lambda: len(estimates) > 5, "estimates")

    cell.remove(sensors["head_a"])
    cell.wait_for_status("error_estimator: estimate", "without head_a")
    cell.wait_for_status("error_estimator: /stage/head_a/samples", "stale")
    cell.wait_until(lambda: newest_mask(estimates) & 0b1111 == 0b1110, "estimates from three heads")
    assert int(block_of(estimates[-1]).column("observable")[-1]) & 0b11 == 0b11

    cell.remove(sensors["head_b"])
    cell.wait_for_status("error_estimator: estimate", "not observable: eyc")
    cell.wait_until(lambda: newest_mask(estimates) & 0b1111 == 0b1100, "estimates from two heads")
    check_against_truth(estimates[2:], plant)

    cell.remove(sensors["head_c"])
    cell.wait_for_status(
        "error_estimator: estimate", "the rotation is as sure as the ring is in place, for there is head_d alone"
    )
    cell.wait_until(lambda: newest_mask(estimates) & 0b1111 == 0b1000, "the rotation from one head")
    seen = int(block_of(estimates[-1]).column("observable")[-1])
    assert seen & 0b11 == 0 and seen >> 5 & 1
    cell.remove(sensors["head_d"])
    cell.wait_for_status("error_estimator: estimate", "no head is there")
    cell.wait_for_silence(estimates)
    before = len(estimates)
    cell.run(EncoderHead, "encoder_head_d", source="mock")
    cell.run(EncoderHead, "encoder_head_c", source="mock")
    cell.wait_until(lambda: len(estimates) > before + 5, "estimates with the head that came back")
    check_against_truth(estimates[2:], plant)


def test_two_neighbouring_heads_are_not_called_too_few(cell, monkeypatch):
    log = Log(monkeypatch, ErrorEstimator)
    for head in "ac":
        cell.run(EncoderHead, f"encoder_head_{head}", source="mock")
    cell.run(ErrorEstimator, "error_estimator", period=PERIOD, check_turns=0.0)
    said = "head_a and head_c alone do not tell rotation from displacement, and there is no command that is believed"
    cell.wait_for_status("error_estimator: estimate", said)
    assert log.count(said) == 1, "once, however many estimates are impossible"
    cell.run(EncoderHead, "encoder_head_b", source="mock")
    cell.wait_until(lambda: log.count("estimate: as it should be again") > 0, "the log to say that it is over")


def test_what_a_silence_of_all_heads_leaves_open_of_positioning_is_said(cell, sensors, monkeypatch):
    """What that is, drives in closed form show (pipeline/test_command_belief.py)."""
    cell.run(ErrorEstimator, "error_estimator", period=PERIOD, check_turns=0.0)
    cell.wait_for_status("error_estimator: estimate", "complete")
    monkeypatch.setattr(CommandBelief, "untold", 1.5e-4)
    cell.wait_for_status("error_estimator: estimate", "positioning is uncertain by 150 µrad until a change of speed")
    assert cell.status("error_estimator: estimate").level == b"\x01"
    monkeypatch.setattr(CommandBelief, "untold", 0.0)
    cell.wait_for_status("error_estimator: estimate", "complete")


def test_autocollimator_and_command_go_stale(cell, estimates, sensors, plant):
    cell.run(ErrorEstimator, "error_estimator", period=PERIOD, check_turns=0.0)
    cell.wait_for_status("error_estimator: estimate", "complete")
    sensors["autocollimator"].trigger_deactivate()
    name = "error_estimator: estimate"
    cell.wait_until(
        lambda: cell.has_status(name, "not observable: eac, ebc") and cell.status(name).level == b"\x01",
        "a warning, not an error, that the tilt is missing",
    )
    sensors["command"].trigger_deactivate()
    cell.wait_for_status("error_estimator: estimate", "not observable: eac, ebc, ecc")
    sensors["autocollimator"].trigger_activate()
    sensors["command"].trigger_activate()
    cell.wait_for_status("error_estimator: estimate", "complete")
    assert check_against_truth(estimates[2:], plant) == {"exc", "eyc", "eac", "ebc", "ecc"}


def test_the_estimator_is_killed_and_comes_back(cell, estimates, sensors, plant):
    process = cell.start("error_estimator", period=PERIOD, check_turns=0.0)
    cell.wait_until(lambda: len(estimates) > 5, "estimates")
    process.send(signal.SIGKILL)
    cell.wait_until(lambda: process.exit_code is not None, "end of the process")
    cell.wait_for_silence(estimates)  # what was on its way by then
    before = len(estimates)
    cell.start("error_estimator", period=PERIOD, check_turns=0.0)
    cell.wait_until(lambda: len(estimates) > before + 5, "estimates of its successor")
    stamps = [message.header.stamp.sec * 10**9 + message.header.stamp.nanosec for message in estimates]
    assert stamps == sorted(stamps)
    check_against_truth(estimates[2:before] + estimates[before + 2 :], plant)


def test_what_is_old_or_no_block_is_refused(cell, estimates):
    topic = cell.wire.topic("head_samples", "a")
    cell.run(ErrorEstimator, "error_estimator", period=PERIOD, check_turns=0.0)
    send_block, send = cell.publish_blocks(topic), cell.publish_on(topic)
    old = cell.node.get_clock().now().nanoseconds - 5_000_000_000
    times = old + np.arange(10) * PERIOD_NS
    send_block(block_from_samples(times, ("angle",), np.zeros((10, 1))))
    cell.wait_for_status(f"error_estimator: {topic.name}", "are the clocks of all computers alike")
    good = messages.block_bytes(SampleBlock(old, ("t", "angle"), np.zeros((1, 2))), topic.frame)
    wrong = deserialize_message(good, PointCloud2)
    wrong.height = 3
    send(wrong)
    cell.wait_for_status(f"error_estimator: refused {topic.name}", "height 3")
    cell.spin_for(0.2)
    assert estimates == []


def send_blocks(cell, plant, duration_ns, change, until):
    """Blocks of 50 ms of all instruments in step with the clock, each as `change` makes it; when they began (ns).

    For so long at least, and until a condition holds: of a computer that was busy for half a second all is too old.
    """
    streams = [f"head_{head}" for head in "abcd"] + ["autocollimator", "command"]
    topics = [cell.wire.topic("head_samples", head) for head in "abcd"]
    topics += [cell.wire.topic("autocollimator_samples"), cell.wire.topic("command_samples")]
    send = dict(zip(streams, map(cell.publish_blocks, topics), strict=True))
    began_ns = sent_ns = cell.node.get_clock().now().nanoseconds
    while sent_ns < began_ns + duration_ns or not until():
        assert sent_ns < began_ns + PATIENCE * NANOSECONDS, f"waited {PATIENCE} s; diagnostics: {cell.statuses}"
        for stream, publish in send.items():
            first = plant.index_at(stream, sent_ns)
            count = plant.index_at(stream, sent_ns + 50_000_000) - first
            publish(change(stream, plant.samples(stream, first, count)))
        sent_ns += 50_000_000
        cell.wait_until(lambda until=sent_ns: cell.node.get_clock().now().nanoseconds > until, "time to pass")
    return began_ns


def test_a_head_that_contradicts_the_others_is_told_and_left_out(cell, estimates, plant):
    """One head jumps by ten lines: which one, its course tells."""
    cell.run(ErrorEstimator, "error_estimator", period=PERIOD, check_turns=0.0)
    jump_ns = 2**62

    def change(stream, block):
        nonlocal jump_ns
        if jump_ns == 2**62 and len(estimates) > 8 and newest_mask(estimates) & 0b1111 == 0b1111:
            jump_ns = int(block.times_ns[-1]) + 200_000_000
            jump_ns -= jump_ns % WINDOW_NS  # of a jump within a window that shows but a part, told as a scatter
        jumped = block.rows.copy()
        jumped[:, 1] += np.where(block.times_ns > jump_ns, 2e-3, 0.0) if stream == "head_a" else 0.0
        return SampleBlock(block.stamp_ns, block.names, jumped)

    def three_are_left():
        return bool(estimates) and newest_mask(estimates) & 0b1111 == 0b1110

    send_blocks(cell, plant, 1_200_000_000, change, three_are_left)
    status = cell.wait_for_status("error_estimator: estimate", "head_a: off by ")
    counts = float(status.message.partition("head_a: off by ")[2].split()[0])
    assert counts == pytest.approx(2e-3 / RESOLUTION, rel=0.2), "by as much as it jumped, in the mean over a window"
    assert "redundancy is lost" in status.message
    # Between the samples before and after the jump, a small part of it may pass for noise.
    near = (jump_ns - 60_000_000, jump_ns + 100_000_000)
    spans = [block_of(each).times_ns[[0, -1]] for each in estimates]
    away = [each for each, (a, b) in zip(estimates, spans, strict=True) if b <= near[0] or near[1] <= a]
    assert check_against_truth(away, plant) == {"exc", "eyc", "eac", "ebc", "ecc"}


def test_a_single_sample_that_is_refused_is_told_with_its_reason(cell, estimates, plant):
    """Its head goes on: less than a tenth of its samples are refused, and no other word would tell."""
    cell.run(ErrorEstimator, "error_estimator", period=PERIOD, check_turns=0.0)
    harmed = []

    def change(stream, block):
        rows = block.rows.copy()
        if stream == "head_b" and estimates and not harmed:
            rows[len(rows) // 2, 1] = 1e30
            harmed.append(block.stamp_ns)
        return SampleBlock(block.stamp_ns, block.names, rows)

    name = f"error_estimator: {cell.wire.topic('head_samples', 'b').name}"
    words = "samples refused: 1 beyond what the instrument can show"
    heard = cell.collect(cell.wire.topic("diagnostics"))

    def told():
        return any(words in each.message for array in heard for each in array.status if each.name == status_name(name))

    send_blocks(cell, plant, 200_000_000, change, told)
    assert cell.figures(name)["refused_samples"] == "1"
    assert newest_mask(estimates) & 0b0010


def test_heads_that_contradict_one_another_from_the_start_publish_nothing(cell, estimates, plant):
    """Nothing tells which one stands off; the reset believes them again, and they contradict one another again."""
    # patience: on a loaded computer a head may come late, and three heads contradict nothing
    cell.run(ErrorEstimator, "error_estimator", period=PERIOD, check_turns=0.0, patience=2.0)

    def change(stream, block):
        return SampleBlock(block.stamp_ns, block.names, block.rows + [0.0, 5e-4] if stream == "head_a" else block.rows)

    name, words = "error_estimator: estimate", "nothing tells which is wrong"
    send_blocks(cell, plant, 1_000_000_000, change, lambda: cell.has_status(name, words))
    status = cell.wait_for_status(name, words)
    assert status.level == b"\x02"
    assert estimates == []
    assert cell.call(Trigger, "/error_estimator/reset").message.startswith("believed again: heads")


@shows(
    Row(
        "messages",
        "A block of a head stamped 10 s to 365 days ahead, live",
        "`error_estimator`: refused, stamped in the future; are all clocks alike?",
        "the message is refused, the stream goes on",
        "everything",
        "at once",
    ),
)
@pytest.mark.parametrize("ahead_ns", [10_000_000_000, 3_600_000_000_000, 365 * 86_400_000_000_000])
def test_stamps_from_the_future_silence_nothing(cell, estimates, plant, ahead_ns):
    # patience: on a loaded computer a block may come late
    cell.run(ErrorEstimator, "error_estimator", period=PERIOD, check_turns=0.0, patience=2.0)
    wrong = []

    def change(stream, block):
        if stream == "head_b" and not wrong:
            wrong.append(block.stamp_ns)
            return SampleBlock(block.stamp_ns + ahead_ns, block.names, block.rows)
        return block

    with lost_time(lambda: [os.getpid()]) as lost:
        send_blocks(cell, plant, 1_000_000_000, change, lambda: whole_ns(estimates))
        check("all streams again", whole_ns(estimates) - wrong[0], 0.8, lost())
    cell.wait_for_status(f"error_estimator: refused {cell.wire.topic('head_samples', 'b').name}", "in the future")
    check_against_truth(estimates, plant)


def test_two_publishers_of_a_head_are_told_and_the_head_is_left_out(cell, estimates, plant):
    topic = cell.wire.topic("head_samples", "c")
    cell.run(ErrorEstimator, "error_estimator", period=PERIOD, check_turns=0.0)
    second = cell.publish_blocks(topic)

    def change(stream, block):
        if stream == "head_c":
            second(SampleBlock(block.stamp_ns + 1_000_000, block.names, block.rows + [0.0, 1e-4]))
        return block

    name, words = f"error_estimator: publishers of {topic.name}", "several publishers share"

    def is_left_out():
        return bool(estimates) and newest_mask(estimates) & 0b1111 == 0b1011 and cell.has_status(name, words)

    send_blocks(cell, plant, 2_000_000_000, change, is_left_out)
    assert "test_harness" in cell.wait_for_status(name, words).message


def test_an_eccentricity_that_nobody_calibrated_is_said(cell, sensors, tmp_path):
    """Off by 4 µm, which the stage itself could move: no mistake is told, but it is as uncertain."""
    text = config("stage.yaml").read_text(encoding="utf-8")
    assert "eccentricity: [2.4e-05, -1.1e-05]" in text
    stage = tmp_path / "stage.yaml"
    stage.write_text(text.replace("[2.4e-05, -1.1e-05]", "[2.8e-05, -1.1e-05]"), encoding="utf-8")
    cell.run(ErrorEstimator, "error_estimator", period=PERIOD, stage=str(stage))
    cell.wait_for_status(
        "error_estimator: estimate", "eccentricity of the ring and error motion are not told apart", 60
    )
    assert float(cell.figures("error_estimator: estimate")["unresolved_radial_um"]) == pytest.approx(4.0, abs=1.0)
