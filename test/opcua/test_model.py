"""The information model: names, units and ranges, held against lists written apart from it."""

from __future__ import annotations

import pytest

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.description.stage_limits import StageLimits
from rotary_error_monitor.opcua.board import Quality
from rotary_error_monitor.opcua.model import CellDescription, health_variables, information_model
from rotary_error_monitor.opcua.units import UNITS

NUMBERS = {"µm": 13384, "°C": 4408652, "s": 5457219, "Hz": 4740186, "1": 4404786}
"""UnitId of common codes as the OPC Foundation publishes them (UNECE_to_OPCUA.csv)."""


def model(machine="xyzac_trt", limits=None):
    stage = load_stage()
    return information_model(
        CellDescription(
            limits or stage.limits,
            ("exc", "eyc", "eac", "ebc", "ecc"),
            load_machine(machine) if machine else None,
            lambda node, what: f"{node}: {what}",
        )
    )


@pytest.mark.parametrize("symbol", NUMBERS)
def test_units_have_their_published_numbers(symbol):
    assert UNITS[symbol].number == NUMBERS[symbol]


@pytest.mark.parametrize("machine", ["", "xyzac_trt", "grinder_zhou2023"])
def test_names_are_those_of_the_house(machine):
    found = {variable.path for variable in model(machine)}
    assert len(found) == len(model(machine))
    axes = load_machine(machine).letters if machine else ()
    expected = {f"error_motion/{name}" for name in ("exc", "eyc", "ezc", "eac", "ebc", "ecc")}
    expected |= {f"{folder}/{a}" for folder in ("axis_corrections", "applied_corrections") for a in axes}
    if machine:
        expected |= {f"{folder}/{name}" for folder in ("tool_offset", "corrected_offset") for name in "xyzabc"}
    kept = ("error_motion/", "tool_offset/", "corrected_offset/", "axis_corrections/", "applied_corrections/")
    assert {path for path in found if path.startswith(kept)} == expected
    assert ("compensation/latched" in found) == bool(machine)


def test_lengths_are_in_micrometres_and_angles_in_microradians():
    for variable in model():
        if variable.folder in ("tool_offset", "corrected_offset"):
            assert variable.unit.symbol == ("µm" if variable.name in "xyz" else "µrad")
        if variable.folder == "axis_corrections":
            assert variable.unit.symbol == ("µm" if variable.name in "XYZ" else "µrad")
        if variable.folder == "error_motion":
            assert variable.unit.symbol == ("µrad" if variable.name in ("eac", "ebc", "ecc") else "µm")
        if variable.type is float:
            assert variable.unit in UNITS.values()
            assert variable.range[0] < variable.range[1]


def test_ranges_are_the_limits_of_the_stage():
    limits = StageLimits(radial=12e-6, tilt=34e-6, axial=5e-6, following_error=78e-6)
    sizes = {v.name: v.range for v in model(limits=limits) if v.folder == "error_motion"}
    expected = {"exc": 12, "eyc": 12, "ezc": 5, "eac": 34, "ebc": 34, "ecc": 78}
    assert {name: (round(low, 9), round(high, 9)) for name, (low, high) in sizes.items()} == {
        name: (-size, size) for name, size in expected.items()
    }


def test_what_keeps_within_a_limit_names_a_limit_that_is_there():
    found = {variable.path: variable for variable in model()}
    limited = [variable for variable in found.values() if variable.range_of]
    assert len(limited) == 6 + 6 + 5 + 5
    assert all(found[variable.range_of].unit == variable.unit for variable in limited)


def test_only_what_sensors_determine_is_sensed():
    assert [variable.path for variable in model() if not variable.sensed] == ["error_motion/ezc"]


def test_qualities_are_status_codes_of_the_library():
    ua = pytest.importorskip("asyncua").ua
    for quality in Quality:
        code = ua.StatusCode(getattr(ua.StatusCodes, quality.value))
        assert code.is_bad() == quality.is_bad
        assert code.is_good() == (quality is Quality.GOOD)


def test_health_shows_of_a_status_what_a_stream_has():
    paths = [each.path for each in health_variables("n: s", ("rate_hz", "age_ms", "lost_samples", "verdict"))]
    assert [path.rpartition("/")[2] for path in paths] == [
        "level", "message", "usable", "rate_hz", "age_ms", "lost_samples",
    ]  # fmt: skip
    assert {path.rpartition("/")[0] for path in paths} == {"health/n: s"}
