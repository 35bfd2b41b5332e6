"""What is said that the sensors of a stage determine is what an estimate of a recording of it has."""

from __future__ import annotations

from copy import deepcopy

import numpy as np
import pytest
from described_stages import stage_of
from world import Options, make_recording, random_stage

from faults.judging import judge
from rotary_error_monitor.pipeline.observability import possible_components

LAYOUTS = {
    "opposed along x": (0.0, np.pi),
    "opposed along y": (np.pi / 2, 3 * np.pi / 2),
    "opposed askew": (0.5, 0.5 + np.pi),
    "at right angles": (0.0, np.pi / 2),
    "three": (0.0, 2.1, 4.2),
    "four": (0.0, np.pi / 2, np.pi, 3 * np.pi / 2),
}
PROBES = {"none": (), "in the plane": (0.3,), "two in the plane": (0.3, 1.9)}


@pytest.mark.parametrize("probes", PROBES)
@pytest.mark.parametrize("heads", LAYOUTS)
def test_what_is_said_to_be_determined_is_there(heads, probes):
    """Any two heads were said to determine both radial components and the rotation."""
    section = deepcopy(dict(next(each for each in map(random_stage, range(100)) if "autocollimator" in each)))
    section["encoder"]["heads"] = {"abcd"[place]: {"azimuth": at} for place, at in enumerate(LAYOUTS[heads])}
    amplifier = {"noise": 1e-8, "resolution": 5e-9, "range": 1e-4, "uncertainty": 1e-7, "height": 0.0}
    section["sensors"] = {
        f"p{place}": {"kind": "radial_probe", "azimuth": at, **amplifier} for place, at in enumerate(PROBES[probes])
    }
    recording = make_recording(3, duration=2.0, stage=section, options=Options(motion="steady", odd_rates=False))
    found = judge(recording, section)
    there = tuple(name for name, part in found.available.items() if part > 0.5)
    assert there == possible_components(stage_of(section)), found.doubted
