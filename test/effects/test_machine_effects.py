"""Each effect of the five-axis machine against the product of transforms of its page, multiplied out here once more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rotary_error_monitor.description.machine import machine_from_mapping
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.machine_effect import MachineEffect
from rotary_error_monitor.kinds.mount.effects import MountEffect
from rotary_error_monitor.machine.components import arrange_components
from rotary_error_monitor.machine.uncertainty import uncertain_shifts
from rotary_error_monitor.twin.machine import MachineRecording, predict_probe

SECTION = {
    "travel": {"X": [-3.0, 3.0], "Y": [-1.0, 1.0], "Z": [-1.0, 1.0], "C": [-np.pi, np.pi], "A": [-1.9, 1.9]},
    "squareness": {"XY": 1e-5, "XZ": -2e-5, "YZ": 3e-5},
    "orientation": {"C": [2e-6, -1e-5], "A": [-6e-5, 4e-5]},
    "pivot_offset": [-3e-6, 6e-6, 0.0],
    "head_length": 0.35,
    "tool_length": 0.15,
    "expansion": {"X": 1e-6, "Y": 0.0, "Z": 0.0},
    "reference_temperature": 20.0,
    "errors": {
        "EXX": {"poly": [0.0, 3e-6, -8e-6]},
        "EBY": {"poly": [0.0, -4e-6]},
        "EZZ": {"poly": [0.0, 1e-5]},
        "ECC": {"harmonic": [{"order": 1, "cos": 5e-6, "sin": 1e-5}]},
        "EYA": {"harmonic": [{"order": 2, "cos": -2e-6, "sin": 1e-6}]},
    },
}
LETTERS = ("X", "Y", "Z", "C", "A")
RNG = np.random.default_rng(4)
LOW, HIGH = np.array([SECTION["travel"][letter] for letter in LETTERS]).T
POSES = RNG.uniform(LOW, HIGH, (17, 5))
WAY = RNG.choice([-1.0, 1.0], (17, 5))
TEMPERATURE = RNG.uniform(19.0, 25.0, 17)
RECORDING = MachineRecording(POSES, WAY, TEMPERATURE, np.zeros((17, 3)))
MACHINE = machine_from_mapping(SECTION)


def move(rotation=(0, 0, 0), shift=(0, 0, 0)):
    """A transform: rotation by a vector, then shift."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(rotation).as_matrix()
    matrix[:3, 3] = shift
    return matrix


def tool_tip(i, added=None, perfect=False):
    """Tool tip of pose i by the page's product; `added` are changes by name, `perfect` leaves every error out."""
    added = added or {}
    q = dict(zip(LETTERS, POSES[i], strict=True))

    def error(axis):
        values = {}
        travel = SECTION["travel"][axis]
        u = (2 * q[axis] - sum(travel)) / (travel[1] - travel[0])
        for name, content in SECTION["errors"].items():
            if name[2] == axis:
                waves = content.get("harmonic", [])
                values[name] = sum(c * u**k for k, c in enumerate(content.get("poly", []))) + sum(
                    w["cos"] * np.cos(w["order"] * q[axis]) + w["sin"] * np.sin(w["order"] * q[axis]) for w in waves
                )
        own = {"X": "EXX", "Y": "EYY", "Z": "EZZ", "C": "ECC", "A": "EAA"}[axis]
        if axis in "XYZ":
            warm = TEMPERATURE[i] - 20.0
            expansion = SECTION["expansion"][axis] + added.get(f"expansion.{axis}", 0.0)
            values[own] = values.get(own, 0.0) + expansion * warm * q[axis]
        values[own] = values.get(own, 0.0) - added.get(f"backlash.{axis}", 0.0) / 2 * WAY[i][LETTERS.index(axis)]
        for name, change in added.items():
            if name.startswith("E") and name[2] == axis:
                values[name] = values.get(name, 0.0) + change(q[axis], u)
        if perfect:
            values = {}
        return move([values.get(f"E{d}{axis}", 0.0) for d in "ABC"], [values.get(f"E{d}{axis}", 0.0) for d in "XYZ"])

    def known(name, key, index=None):
        value = SECTION[name][key] if index is None else SECTION[name][key][index]
        label = f"{name}.{key}" if index is None else f"{name}.{key}.{index}"
        return 0.0 if perfect else value + added.get(label, 0.0)

    pivot = np.zeros(3) if perfect else np.array(SECTION["pivot_offset"]) + added.get("pivot", np.zeros(3))
    length = 0.5 + (0.0 if perfect else added.get("tool_length", 0.0))
    product = (
        move(shift=(0, q["Y"], 0))
        @ error("Y")
        @ move((0, 0, -known("squareness", "XY")))
        @ move(shift=(q["X"], 0, 0))
        @ error("X")
        @ move((-known("squareness", "YZ"), known("squareness", "XZ"), 0))
        @ move(shift=(0, 0, q["Z"]))
        @ error("Z")
        @ move((known("orientation", "C", 0), known("orientation", "C", 1), 0))
        @ move((0, 0, q["C"]))
        @ error("C")
        @ move(shift=pivot)
        @ move((0, known("orientation", "A", 0), known("orientation", "A", 1)))
        @ move((q["A"], 0, 0))
        @ error("A")
        @ move(shift=(0, 0, -length))
    )
    if "workpiece" in added and not perfect:
        product = np.linalg.inv(added["workpiece"]) @ product
    return product[:3, 3]


CLOSED_FORMS = {
    "squareness": ("XZ", {"angle": 7e-6}, {"squareness.XZ": 7e-6}),
    "axis_scale": ("Y", {"relative": 4e-6}, {"EYY": lambda q, u: 4e-6 * q}),
    "thermal_expansion": ("Z", {"coefficient": 2e-6}, {"expansion.Z": 2e-6}),
    "axis_backlash": ("A", {"width": 5e-5}, {"backlash.A": 5e-5}),
    "axis_straightness": ("EXZ", {"sag": 1e-5}, {"EXZ": lambda q, u: 1e-5 * u**2}),
    "axis_angular": ("ECY", {"slope": -8e-6}, {"ECY": lambda q, u: -8e-6 * u}),
    "cyclic_error": (
        "X",
        {"period": 0.016, "cos": 2e-6, "sin": -3e-6},
        {"EXX": lambda q, u: 2e-6 * np.cos(2 * np.pi * q / 0.016) - 3e-6 * np.sin(2 * np.pi * q / 0.016)},
    ),
    "rotary_harmonic": (
        "C",
        {"order": 3, "cos": 6e-6, "sin": 2e-6},
        {"ECC": lambda q, u: 6e-6 * np.cos(3 * q) + 2e-6 * np.sin(3 * q)},
    ),
    "pivot_offset": ("", {"shift": [4e-6, -2e-6]}, {"pivot": np.array([4e-6, -2e-6, 0.0])}),
    "axis_orientation": ("A", {"tilt": [1e-5, -2e-5]}, {"orientation.A.0": 1e-5, "orientation.A.1": -2e-5}),
    "head_droop": ("", {"coefficient": 9e-6}, {"EAA": lambda q, u: 9e-6 * np.sin(q)}),
    "tool_length": ("", {"offset": 5e-6}, {"tool_length": 5e-6}),
    "setup_offset": (
        "",
        {"shift": [1e-5, -2e-5, 3e-5], "rotation": [1e-5, 2e-5, -1e-5]},
        {"workpiece": move((1e-5, 2e-5, -1e-5), (1e-5, -2e-5, 3e-5))},
    ),
}
EFFECTS = load_effects(MachineEffect)


def expected_probe(added=None):
    return np.array([tool_tip(i, added) - tool_tip(i, perfect=True) for i in range(len(POSES))])


def test_every_effect_has_a_closed_form():
    assert {effect.name for effect in EFFECTS} == set(CLOSED_FORMS)


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_effect_agrees_with_its_formula(effect):
    location, parameters, added = CLOSED_FORMS[effect.name]
    cause = Cause(effect, location, effect.values_from(parameters))
    expected = expected_probe(added)
    # Errors of one axis add up before they act as one small rotation: products of errors, 1e-5 of 1e-5, may differ.
    np.testing.assert_allclose(predict_probe(MACHINE, RECORDING, (cause,)), expected, rtol=0, atol=3e-9)
    assert np.abs(expected - expected_probe()).max() > 1e-6, "the example must show the effect"
    assert location in effect.locations(MACHINE)


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_effect_without_size_changes_nothing(effect):
    location = CLOSED_FORMS[effect.name][0]
    idle = Cause(effect, location, effect.start(location))
    plain = predict_probe(MACHINE, RECORDING)
    np.testing.assert_allclose(predict_probe(MACHINE, RECORDING, (idle,)), plain, rtol=0, atol=1e-15)


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_effect_says_what_it_is(effect):
    _, parameters, _ = CLOSED_FORMS[effect.name]
    values = effect.values_from(parameters)
    reported = effect.report(values, np.zeros((len(values), len(values))))
    assert effect.title and effect.source
    for name, value in parameters.items():
        np.testing.assert_allclose(reported[name].value, value, rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "size", "added"),
    [
        ("squareness", 2e-6, [{f"squareness.{pair}": 2e-6} for pair in ("XY", "XZ", "YZ")]),
        ("orientation", 1e-6, [{f"orientation.{axis}.{k}": 1e-6} for axis in "CA" for k in (0, 1)]),
        ("pivot_offset", 1e-6, [{"pivot": np.array(v)} for v in ([1e-6, 0, 0], [0, 1e-6, 0])]),
        ("tool_length", 1e-6, [{"tool_length": 1e-6}]),
        ("head_length", 1e-6, [{"tool_length": 1e-6}]),
        ("expansion", 2e-7, [{f"expansion.{axis}": 2e-7} for axis in "XYZ"]),
        (
            "errors.linear",
            8e-7,
            [
                {"EXX": lambda q, u: 8e-7 * u},
                {"EXX": lambda q, u: 8e-7 * u**2},
                {"EZZ": lambda q, u: 8e-7 * u},
                {"EYA": lambda q, u: 8e-7 * np.cos(2 * q)},
                {"EYA": lambda q, u: 8e-7 * np.sin(2 * q)},
            ],
        ),
    ],
)
def test_uncertain_parameters_are_moved_one_by_one(name, size, added):
    machine = machine_from_mapping({**SECTION, "uncertainty": {name: size}})
    shifts = uncertain_shifts(machine)
    assert len(shifts) == len(added)
    for shift, change in zip(shifts, added, strict=True):
        moved = predict_probe(shift.machine, RECORDING) - predict_probe(machine, RECORDING)
        np.testing.assert_allclose(moved, expected_probe(change) - expected_probe(), rtol=0, atol=2e-10)


@pytest.mark.parametrize("name", ["axis_scale", "cyclic_error", "rotary_harmonic", "axis_harmonic", "axis_gear_ratio"])
@pytest.mark.parametrize("seed", range(3))
def test_an_axis_that_is_inclined_is_off_along_itself(name, seed):
    """Nothing across it: a scale is off in the direction in which it lies."""
    generator = np.random.default_rng(seed)
    direction = generator.normal(size=3)
    direction /= np.linalg.norm(direction)
    effects = (*load_effects(MachineEffect), *load_effects(MountEffect))
    effect = next(each for each in effects if each.name == name)
    letter = "X" if name in ("axis_scale", "cyclic_error") else "C"
    inclined = replace(MACHINE.axis(letter), direction=tuple(direction.tolist()))
    axes = tuple(inclined if axis.letter == letter else axis for axis in MACHINE.axes)
    machine = replace(MACHINE, axes=axes, errors={})
    start = effect.start(letter)
    values = np.where(start == 0, [parameter.scale for parameter in effect.parameters], start)
    errors = arrange_components(effect.amend(machine, values, letter)).at(POSES.T, WAY.T, None)
    first = 0 if letter == "X" else 3
    off = errors[first : first + 3, LETTERS.index(letter)]
    along = direction @ off
    assert np.ptp(along) > 0
    assert off == pytest.approx(np.outer(direction, along), rel=1e-12, abs=1e-20)
