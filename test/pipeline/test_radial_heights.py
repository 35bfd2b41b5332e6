"""Radial error motion at heights, against the true rotor of the independent world."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from described_stages import stage_of
from pushed_inputs import push_block
from world import Options, make_recording, random_stage

from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.cli import main
from rotary_error_monitor.codec.error_motion_blocks import block_from_error_motion
from rotary_error_monitor.description.wire import wire_of
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes.error_estimator import ErrorEstimator
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.pipeline.radial_heights import figures_of, radial_block

COLUMNS = ("height", "radial_x", "radial_y", "observable", "var_x", "var_y", "cov_xy")
HEIGHTS = (0.0, 0.016, -0.1, 0.2)
WITH_FOUR = [seed for seed in range(20) if len(random_stage(seed)["encoder"]["heads"]) == 4]


def recorded(seed):
    options = Options(motion="steady", odd_rates=False, peak_speed=4.0, noise_shape=False)
    return make_recording(seed, duration=3.0, stage=random_stage(seed), options=options)


def estimated(recording):
    estimator, blocks = Estimator(stage_of(recording.stage)), []
    streams = {"head_a", "head_b", "head_c", "head_d", "autocollimator", "command"}
    for arrival, topic, block in recording.timeline():
        name = topic.split("/")[2]
        if name in streams and len(block.rows):
            blocks += push_block(estimator, name, block, arrival)
    return blocks + estimator.finish()


def at_heights(block, heights=HEIGHTS):
    return radial_block(block, heights)


def test_the_truth_is_inside_the_bounds_that_go_out_with_it():
    """By exact geometry: where a point of the axis at that height is, less where it is on a perfect axis."""
    inside, sizes, effects = [], [], []
    for seed in WITH_FOUR[:4]:
        recording = recorded(seed)
        for block in estimated(recording):
            found = at_heights(block)
            assert found.names == ("t", *COLUMNS) and len(found.rows) == len(HEIGHTS) * len(block.theta)
            pose = recording.truth(found.times_ns)
            height, angle = found.column("height"), np.hypot(pose.eac, pose.ebc)
            lean = height * np.sinc(angle / np.pi)  # Rodrigues' formula for (0, 0, height)
            truth = np.stack([pose.exc + lean * pose.ebc, pose.eyc - lean * pose.eac], axis=1)
            seen = found.column("observable") == 1.0
            off = np.stack([found.column("radial_x"), found.column("radial_y")], axis=1) - truth
            std = np.sqrt(np.stack([found.column("var_x"), found.column("var_y")], axis=1))
            assert (found.columns(COLUMNS[1:])[~seen] == 0.0).all()
            inside.append((np.abs(off) <= 1.959964 * std)[seen])
            high = seen & (height == 0.2)
            sizes.append(std[high])
            effects.append(truth[high])
    assert np.concatenate(inside).mean() >= 0.93
    # an uncertainty that bounds something: small beside the motion itself, once a turn has shown the description
    assert np.quantile(np.concatenate(sizes), 0.25) < 0.2 * np.std(np.concatenate(effects))


def test_without_tilt_only_the_ring_is_told():
    for seed in WITH_FOUR[:1]:
        recording = recorded(seed)
        stage = {name: part for name, part in recording.stage.items() if name not in ("autocollimator", "mirror")}
        estimator, blocks = Estimator(stage_of(stage)), []
        for arrival, topic, block in recording.timeline():
            name = topic.split("/")[2]
            if (name.startswith("head_") or name == "command") and len(block.rows):
                blocks += push_block(estimator, name, block, arrival)
        for block in blocks:
            found = at_heights(block)
            assert (found.column("observable") == (found.column("height") == 0.0)).all()


def test_figures_are_the_latest_in_micrometres_and_have_gaps():
    (seed, *_) = WITH_FOUR
    block = next(each for each in estimated(recorded(seed)) if len(each.theta) > 1)
    found = at_heights(block)
    names, values, stds = figures_of(found)
    assert names[:4] == ("radial_x_at_0mm", "radial_y_at_0mm", "radial_x_at_16mm", "radial_y_at_16mm")
    assert names[5] == "radial_y_at_minus_100mm"
    row = found.rows[-1]
    assert values[-2:] * 1e-6 == pytest.approx(row[2:4]) and stds[-2:] * 1e-6 == pytest.approx(np.sqrt(row[5:7]))
    found.rows[-1, 4] = 0.0
    assert np.isnan(figures_of(found)[1][-2:]).all() and np.isfinite(figures_of(found)[1][:-2]).all()


def test_a_replay_gives_the_same_bits(tmp_path):
    """`replay --height` of a bag that holds what was published against what goes out beside that at heights."""
    (seed, *_) = WITH_FOUR
    recording = recorded(seed)
    published = estimated(recording)
    columns = wire_of(stage_of(recording.stage)).topic("error_motion_samples").columns
    blocks = [block_from_error_motion(each, columns) for each in published]
    write_messages(tmp_path / "bag", {**recording.blocks, "/stage/error_motion/samples": blocks})
    twin, out = tmp_path / "stage.yaml", tmp_path / "out.npz"
    twin.write_text(yaml.safe_dump({"stage": recording.stage}), encoding="utf-8")
    arguments = ["replay", str(tmp_path / "bag"), "--twin", str(twin), "--height", "0", "16", "-100", "200"]
    assert main([*arguments, "-o", str(out)]) == 0
    live = [at_heights(block, sorted(HEIGHTS)) for block in published]
    times, rows = np.concatenate([each.times_ns for each in live]), np.concatenate([each.rows for each in live])
    with np.load(out) as replayed:
        assert replayed["heights"].tolist() == sorted(HEIGHTS)
        stamps = replayed["stamp_ns"]
        common = np.isin(times, stamps)
        assert common.mean() > 0.9
        place = np.searchsorted(stamps, times[common]), np.tile(np.arange(4), len(times) // 4)[common]
        seen = rows[common, 4] == 1.0
        for columns, values in (
            (slice(2, 4), replayed["radial"][place]),
            (5, replayed["radial_covariance"][(*place, 0, 0)]),
            (7, replayed["radial_covariance"][(*place, 0, 1)]),
        ):
            assert (values[seen] == rows[common][seen][:, columns]).all()
            assert np.isnan(values[~seen]).all()


@pytest.mark.parametrize(
    ("heights", "is_right"), [([], True), ([0.016, -0.1], True), ([60.0], False), ([np.nan], False)]
)
def test_heights_of_the_node_are_checked(heights, is_right):
    setting = next(each for each in ErrorEstimator.settings if each.name == "heights")
    if is_right:
        setting.check(heights, "here")
        return
    with pytest.raises(
        InputError, match=r"here: parameter 'heights' is \[.*\]; expected: heights above the ring .*, m"
    ):
        setting.check(heights, "here")
