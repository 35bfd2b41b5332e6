"""Diagnosis of a stage without read heads, by three probes; its recordings are written out with numpy."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from probed_stage import AROUND, Withheld, blocks_of, recorded, without_heads

from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.cli import main
from rotary_error_monitor.description.stage import load_stage, stage_mapping
from rotary_error_monitor.description.topics import samples_topic
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.kinds.stage.stretches import LONGEST, stage_problem
from rotary_error_monitor.sensors.library import absent_kinds
from rotary_error_monitor.twin.recording import record_stage

EFFECTS = load_effects(StageEffect)
STAGE = without_heads()
RADIAL = Withheld(radial=((3, (2e-7, -1e-7), (1e-7, 2e-7)),))


def recording_of(streams):
    return record_stage(blocks_of(streams), (), without=absent_kinds(STAGE), listed=tuple(STAGE.sensors))


def diagnosed(streams):
    return diagnose(stage_problem(STAGE, recording_of(streams), EFFECTS))


def test_a_stage_as_described_has_no_gap():
    """At a false-alarm rate of 1 % two of twenty alarm once in sixty times."""
    found = [diagnosed(recorded(seed, stage=STAGE)) for seed in range(20)]
    assert [each.verdict for each in found].count(Verdict.NO_GAP) >= 19


@pytest.mark.parametrize(
    ("withheld", "key", "values"),
    [
        (RADIAL, ("spindle_radial", "order_3"), {"x": (2e-7, -1e-7), "y": (1e-7, 2e-7)}),
        (Withheld(zero={AROUND[0]: 3e-6}), ("probe_zero", AROUND[0]), {}),
        (
            Withheld(form={AROUND[1]: ((2, 3e-7, 2e-7),)}),
            ("probe_form", f"{AROUND[1]}.order_2"),
            {"cos": 3e-7, "sin": 2e-7},
        ),
        (Withheld(gain={AROUND[2]: 0.05}), ("probe_gain", AROUND[2]), {"relative": 0.05}),
        (Withheld(drift={AROUND[0]: 2e-8}), ("probe_drift", AROUND[0]), {}),
    ],
    ids=["radial", "zero", "form", "gain", "drift"],
)
def test_what_the_twin_lacks_is_named(withheld, key, values):
    """In all seeds, alone or as one of what is alike, with values within four standard deviations."""
    for seed in range(5):
        diagnosis = diagnosed(recorded(seed, withheld, STAGE))
        assert diagnosis.verdict is Verdict.EXPLAINED, (seed, diagnosis.remainder)
        (found,) = diagnosis.causes
        alike = {each for group in diagnosis.indistinguishable for each in group.effects}
        assert key in {found.cause.key} | alike, (seed, found.cause.key)
        for name, value in values.items() if found.cause.key == key else ():
            told, std = (np.atleast_1d(getattr(found.parameters[name], part)) for part in ("value", "std"))
            assert np.all(np.abs(told - value) < 4 * std), (seed, name, told, value)


def test_a_long_recording_is_worked_through_in_stretches():
    streams = recorded(3, RADIAL, STAGE, seconds=LONGEST + 16.0)
    diagnosis = diagnosed(streams)
    assert {found.cause.key for found in diagnosis.causes} == {("spindle_radial", "order_3")}


def test_probes_that_are_missing_are_said_and_the_others_used():
    streams = {name: stream for name, stream in recorded(1, RADIAL, STAGE).items() if name != AROUND[0]}
    diagnosis = diagnosed(streams)
    assert {found.cause.key for found in diagnosis.causes} == {("spindle_radial", "order_3")}
    assert any(f"{samples_topic(AROUND[0])}: described, but not recorded" in each for each in diagnosis.remarks)
    with pytest.raises(InputError, match=rf"samples of no sensor; expected .*{AROUND[0]}/samples"):
        recording_of({name: stream for name, stream in streams.items() if name not in AROUND})


def test_from_file_to_file(tmp_path, capsys):
    streams = recorded(2, RADIAL, STAGE)
    write_messages(tmp_path / "bag", {samples_topic(name): blocks for name, blocks in blocks_of(streams).items()})
    twin, improved = tmp_path / "twin.yaml", tmp_path / "improved.yaml"
    twin.write_text(yaml.safe_dump({"stage": stage_mapping(STAGE)}, sort_keys=False), encoding="utf-8")
    arguments = ["diagnose", str(tmp_path / "bag"), "--twin", str(twin), "-o", str(tmp_path / "out")]
    assert main([*arguments, "--write-twin", str(improved)]) == 10
    assert "spindle_radial" in capsys.readouterr().out
    assert (tmp_path / "out" / "diagnosis.html").stat().st_size > 10_000
    found = load_stage(improved)
    assert found.encoder is None and {row.order for row in found.spindle.radial} == {2, 3}
    again = ["diagnose", str(tmp_path / "bag"), "--twin", str(improved), "-o", str(tmp_path / "again")]
    assert main(again) == 0, capsys.readouterr().out
