"""The package's speed by version: what each piece of work takes over a calibration loop, and what became slower.

Held against the version kept last in `history.csv`. `BENCH_KEEP=1` keeps the figures as those of the version that
`package.xml` names; so does whoever makes a release.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from benchmark import history
from described_stages import stage_of
from faults.judging import stream_of
from mock_bags import write_mock_bag, write_stage_bag
from pipeline.test_compensation import MACHINE, motion_block, run
from pushed_inputs import push_block
from world import Options, make_recording, random_stage
from world.recording import AUTOCOLLIMATOR, COMMAND

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.blind_check.cases import write_case
from rotary_error_monitor.calibration.volume import sample_volume
from rotary_error_monitor.cases.making import make_stage_case
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.loading import load_problem, load_twin
from rotary_error_monitor.machine.correction import solve_axis_corrections
from rotary_error_monitor.machine.error_model import predict_tool_offset
from rotary_error_monitor.machine.kinematics import arrange_machine
from rotary_error_monitor.pipeline.compensation import Compensator
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.recordings.analysis import FileAnalysis, Question
from rotary_error_monitor.recordings.replay import replay_bag

PACKAGE = Path(__file__).parents[2] / "package.xml"


def version() -> str:
    """The package's version, as `package.xml` has it."""
    found = ElementTree.parse(PACKAGE).findtext("version")
    assert found
    return found


def estimating(rate: float, duration: float) -> Callable[[], object]:
    section = random_stage(4)
    heads = [f"/stage/head_{name}/samples" for name in section["encoder"]["heads"]]
    options = Options(motion="steady", odd_rates=False, rates=dict.fromkeys([*heads, AUTOCOLLIMATOR, COMMAND], rate))
    recording = make_recording(4, duration=duration, stage=section, options=options)
    streams = [(a, stream_of(t), b) for a, t, b in recording.timeline() if stream_of(t) is not None]
    stage = stage_of(section)

    def work() -> None:
        estimator = Estimator(stage)
        for arrival, stream, block in streams:
            push_block(estimator, stream, block, arrival)
        assert estimator.status.estimates > 0.9 * duration * 1e3

    return work


def modelling() -> dict[str, Callable[[], object]]:
    model = arrange_machine(MACHINE)
    q = sample_volume(MACHINE, 50_000)
    one_by_one = list(q[:1000, None])
    blocks = {ms: motion_block(ms) for ms in range(0, 500, 5)}
    return {
        "machine model: 50,000 offsets": lambda: predict_tool_offset(model, q),
        "machine model: 1,000 corrections one by one": lambda: [
            solve_axis_corrections(model, pose) for pose in one_by_one
        ],
        "compensator: 0.5 s of blocks": lambda: run(Compensator(MACHINE), 500, blocks=blocks.__getitem__),
    }


def recorded(folder: Path) -> dict[str, Callable[[], object]]:
    stage_bag = write_stage_bag(folder / "stage", 10)
    mock_bag = write_mock_bag(folder / "cell", 8_000)
    write_case(make_stage_case(1, "single", ["unbalance"], (300.0, 300.0), False, 40.0), folder / "case")
    twin = load_twin(folder / "case" / "twin.yaml")
    return {
        "reading: a cell of 4 s": lambda: BagReader(mock_bag).read_blocks(),
        "replay: a stage of 10 s": lambda: replay_bag(stage_bag, load_stage()),
        "analyse: a stage of 10 s, without the page": FileAnalysis(stage_bag, None, None, Question(), {}).analyse,
        "diagnose: a stage of 40 s, without the page": lambda: diagnose(load_problem(folder / "case" / "bag", twin)),
    }


def test_speed_beside_that_of_earlier_versions(tmp_path: Path) -> None:
    works = {
        "estimator: 2 s of 6 streams at 1 kHz": estimating(1_000.0, 2.0),
        "estimator: 1 s of 6 streams at 10 kHz": estimating(10_000.0, 1.0),
        **modelling(),
        **recorded(tmp_path),
    }
    speeds = {figure: history.measure(work) for figure, work in works.items()}
    assert all(np.isfinite(speed.ratio) and speed.ratio > 0 for speed in speeds.values())
    print(f"\nversion {version()}: processor time over that of a calibration loop, and beside the version kept last")
    print("\n".join(history.told(speeds, history.read())))
    if os.environ.get("BENCH_KEEP"):
        history.keep(version(), speeds)
