"""Two sensors of one kind at one place are refused with file, line and both places; what is legitimate is not."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from rotary_error_monitor.description.sections import from_content
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.description.stage_section import StageSection
from rotary_error_monitor.errors import InputError

RING = {"lines_per_revolution": 31488, "counts_per_line": 100, "noise": 3e-7}
MAKE = {"noise": 1e-8, "resolution": 0.0, "range": 1e-4, "uncertainty": 1e-8}
TILT = {"kind": "tilt_sensor", "noise": 1e-7, "resolution": 0.0, "range": 1e-3, "uncertainty": 1e-7}
LOAD = {"kind": "force", "azimuth": 0.0, "noise": 0.1, "resolution": 0.0, "range": 99.0, "uncertainty": 0.1}
WARM = {"kind": "thermometer", "noise": 0.1, "resolution": 0.0, "range": 99.0, "uncertainty": 0.1}
ANGLES = st.floats(-math.pi, math.pi)
RADII = st.floats(0.02, 2.0)


def said(stage: dict[str, Any]) -> str:
    """Why a stage is refused; empty where it is not."""
    try:
        from_content(StageSection, stage, "stage")
    except InputError as error:
        return str(error)
    return ""


def with_heads(radius: float, *azimuths: float) -> dict[str, Any]:
    heads = {"abc"[number]: {"azimuth": azimuth} for number, azimuth in enumerate(azimuths)}
    return {"encoder": {"disc_radius": radius, **RING, "heads": heads}}


def fronts_apart(radius: float, between: float, width: float) -> bool:
    """Whether two flat fronts of a width that touch a circle do not cross: corners of one beyond the other's middle."""
    x, y = (
        radius,
        width / 2,
    )  # the corner of a front at azimuth 0 that is nearer to the other, which is its mirror image
    return math.atan2(y, x) < abs(between) / 2


@given(at=ANGLES, radius=RADII, apart=st.floats(0.0, 0.0035), turns=st.sampled_from([-2 * math.pi, 0.0, 2 * math.pi]))
def test_heads_nearer_than_any_is_wide_are_refused(at: float, radius: float, apart: float, turns: float) -> None:
    other = at + apart / radius + turns
    other = other if abs(other) <= 2 * math.pi else other - turns
    told = said(with_heads(radius, at, at + math.pi if at < 0 else at - math.pi, other))
    assert not fronts_apart(radius, apart / radius, 4e-3)
    assert f"heads.c.azimuth: {other} is where head 'a' stands ({at}); expected" in told


@given(at=ANGLES, radius=RADII, more=st.floats(1.0, 3.0))
def test_heads_as_far_apart_as_the_message_asks_for_are_not(at: float, radius: float, more: float) -> None:
    least = re.search(r"expected (\S+) rad or more", said(with_heads(radius, at, at)))
    assert least is not None
    between = float(least[1]) * more * (1 + 1e-9)
    assert fronts_apart(radius, between, 4e-3)
    assert said(with_heads(radius, at, at + between)) == ""


@given(
    azimuth=ANGLES,
    height=st.floats(-0.5, 0.5),
    radius=st.floats(0.0, 0.5),
    off=st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)),
    far=st.floats(0.0031, 1.0),
)
def test_probes_are_refused_within_the_width_of_one(
    azimuth: float, height: float, radius: float, off: tuple[float, float], far: float
) -> None:
    one = {"kind": "radial_probe", "azimuth": azimuth, "height": height, **MAKE}
    near = one | {"azimuth": azimuth + 2e-3 * off[0], "height": height + 2e-3 * off[1]}
    told = r"sensors\.two: at azimuth .* stands {} 'one' \(azimuth .*\); expected 3 mm"
    assert re.search(told.format("radial_probe"), both(one, near))
    assert both(one, one | {"height": height + far}) == ""
    assert both(one, one | {"azimuth": math.remainder(azimuth + far, 2 * math.pi)}) == ""
    face = {"kind": "axial_probe", "azimuth": azimuth, "radius": radius, **MAKE}
    across = face | {"radius": radius + 2e-3 * abs(off[0])}
    assert re.search(told.format("axial_probe"), both(face, across))
    assert both(face, face | {"radius": radius + far}) == ""
    assert both(face, across | {"gain": -1.0}) == "", "one looks from above, one from below"
    assert both(one, face) == "", "they look at other targets"


def both(one: dict[str, Any], two: dict[str, Any]) -> str:
    return said({"sensors": {"one": one, "two": two}})


@given(azimuth=ANGLES)
def test_on_the_axis_no_azimuth_is_another_place(azimuth: float) -> None:
    nose = {"kind": "axial_probe", "radius": 0.0, **MAKE}
    assert "stands axial_probe 'one' (radius 0)" in both(nose, nose | {"azimuth": azimuth})


def test_what_may_stand_together_is_read() -> None:
    shared = {"one": TILT, "two": TILT, "push": LOAD | {"axes": 1}, "pull": LOAD | {"axes": 1}, "w": WARM, "v": WARM}
    assert said({"sensors": shared, "environment": {"reference_temperature": 20.0, "force": ["push", "pull"]}}) == ""


@pytest.mark.parametrize("azimuths", [(0.0, np.pi, 1e-3), (0.0, np.pi, 2 * np.pi - 1e-3)])
def test_heads_of_the_list_are_told_with_their_line(tmp_path: Path, azimuths: tuple[float, ...]) -> None:
    listed = {name: {"kind": "read_head", "azimuth": at} for name, at in zip("abc", map(float, azimuths), strict=True)}
    path = tmp_path / "stage.yaml"
    path.write_text(yaml.safe_dump({"stage": {"encoder": {"disc_radius": 0.1, **RING}, "sensors": listed}}))
    line = 1 + path.read_text().split("\n").index("    c:")
    told = rf"stage\.yaml:{line + 1}: stage\.sensors\.c\.azimuth: \S+ is where head 'a' stands"
    with pytest.raises(InputError, match=told):
        load_stage(path)
