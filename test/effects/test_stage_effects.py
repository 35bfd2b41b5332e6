"""Each effect of the stage against the formula of its page, written out here and evaluated sample by sample."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from rotary_error_monitor.description.harmonics import AngularHarmonic, PlanarHarmonic
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.description.spindle_section import Spindle
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.stage_section import Encoder, Mirror
from rotary_error_monitor.description.two_axis_section import Autocollimator, RadialReference
from rotary_error_monitor.effects.effect import Cause, place_of
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import RotorState, StageEffect, effects_of
from rotary_error_monitor.twin.stage import StageInputs, StageTwin

LINES = 900
SECOND = "tilt_sensor_second"
STAGE = StageDescription(
    encoder=Encoder(
        disc_radius=0.1,
        lines_per_revolution=LINES,
        counts_per_line=100,
        noise=3e-7,
        azimuths={"a": 0.0, "b": math.pi, "c": math.pi / 2, "d": 1.5 * math.pi},
        eccentricity=(2e-5, -1e-5),
        graduation=(AngularHarmonic(2, 1e-6, -2e-6),),
    ),
    autocollimator=Autocollimator(range=5e-4, resolution=5e-7, noise=5e-7),
    mirror=Mirror((1e-4, -5e-5), (PlanarHarmonic(3, (1e-6, 2e-6), (-1e-6, 3e-6)),)),
    spindle=Spindle(
        radial=(PlanarHarmonic(2, (1e-6, -2e-6), (3e-6, 1e-6)),),
        tilt=(PlanarHarmonic(1, (5e-6, 1e-5), (-1e-5, 3e-6)),),
        radial_compliance=2e-8,
        tilt_compliance=5e-8,
        radial_thermal=(3e-7, -1e-7),
        axial=(AngularHarmonic(1, 2e-7, -1e-7), AngularHarmonic(3, 1e-7, 3e-7)),
    ),
    lvdt=RadialReference(height=0.06, noise=5e-8, artefact_eccentricity=(4e-6, 2e-6)),
    sensors={
        "axial_probe_top": ListedSensor(
            "axial_probe",
            *(1e-8, 1e-9, 1e-3, 1e-7),
            zero=3e-6,
            gain=-1.5,
            place={"azimuth": 0.4, "radius": 0.03},
            form=(AngularHarmonic(1, 2e-6, 1e-6),),
        ),
        "radial_probe_low": ListedSensor(
            "radial_probe",
            *(1e-8, 1e-9, 1e-3, 1e-7),
            zero=-1e-6,
            place={"azimuth": 2.0, "height": 0.05},
            form=(AngularHarmonic(2, -1e-6, 5e-7),),
        ),
        SECOND: ListedSensor(
            "tilt_sensor",
            *(1e-7, 1e-8, 1e-3, 1e-6),
            zero=(2e-5, -1e-5),
            gain=-1.2,
            place={"roll": 0.7},
            form=(PlanarHarmonic(1, (4e-5, -2e-5), (2e-5, 4e-5)),),
            fields=("tilt_x", "tilt_y"),
            unit="rad",
        ),
    },
)
TIMES = np.linspace(0.3, 9.7, 23)
SPEED, SWING = 0.8, 3.0


def command(t):
    """Forward and backward."""
    return SWING * np.sin(SPEED * t)


def velocity(t):
    return SWING * SPEED * np.cos(SPEED * t)


def force(t):
    return np.array([40.0 * math.sin(t), -30.0 * math.cos(2 * t)])


def warming(t):
    return 0.3 * t


@dataclass
class Bench:
    """Numbers and additions of one sample, as the page names them; an effect changes some of them."""

    t: float
    stage: StageDescription = STAGE
    theta_added: object = None
    d_added: object = None
    g_added: object = None
    head_added: dict = field(default_factory=dict)
    delays: dict = field(default_factory=dict)
    tilt_changed: object = None
    radial_changed: object = None
    z_added: object = None
    probe_added: dict = field(default_factory=dict)

    def reading(self, stream):
        t = self.t - self.delays.get(stream, 0.0)
        s = self.stage
        theta = command(t) + (self.theta_added(t) if self.theta_added else 0.0)
        turn = np.array([[math.cos(theta), -math.sin(theta)], [math.sin(theta), math.cos(theta)]])

        def harm(rows):
            x = sum(w.x[0] * math.cos(w.order * theta) + w.x[1] * math.sin(w.order * theta) for w in rows)
            y = sum(w.y[0] * math.cos(w.order * theta) + w.y[1] * math.sin(w.order * theta) for w in rows)
            return np.array([x, y])

        fx, fy = force(t)
        d = harm(s.spindle.radial) + s.spindle.radial_compliance * force(t)
        d = d + warming(t) * np.array(s.spindle.radial_thermal)
        g = harm(s.spindle.tilt) + s.spindle.tilt_compliance * np.array([-fy, fx])
        d = d + (self.d_added(t, theta, turn) if self.d_added else 0.0)
        g = g + (self.g_added(t, theta) if self.g_added else 0.0)
        if stream == "autocollimator":
            tilt = turn @ np.array(s.mirror.tilt) + g + harm(s.mirror.flatness)
            return self.tilt_changed(self.t, tilt) if self.tilt_changed else tilt
        if stream == "lvdt":
            radial = d + s.lvdt.height * np.array([g[1], -g[0]]) + turn @ np.array(s.lvdt.artefact_eccentricity)
            return self.radial_changed(radial) if self.radial_changed else radial
        if stream in s.sensors:
            probe = s.sensors[stream]
            if probe.kind == "tilt_sensor":
                roll = probe.place["roll"]
                axes = np.array([[math.cos(roll), -math.sin(roll)], [math.sin(roll), math.cos(roll)]])
                added = self.probe_added[stream](self.t) if stream in self.probe_added else 0.0
                return np.array(probe.zero) + probe.gain * (axes @ (g + harm(probe.form))) + added
            phi = probe.place["azimuth"]
            if probe.kind == "axial_probe":
                along = sum(
                    w.cos * math.cos(w.order * theta) + w.sin * math.sin(w.order * theta) for w in s.spindle.axial
                )
                at = probe.place["radius"] * np.array([math.cos(phi), math.sin(phi)])
                moved = along + (self.z_added(t) if self.z_added else 0.0) + g[0] * at[1] - g[1] * at[0]
            else:
                height = probe.place["height"]
                moved = (d[0] + height * g[1]) * math.cos(phi) + (d[1] - height * g[0]) * math.sin(phi)
            psi = phi - theta
            moved += sum(w.cos * math.cos(w.order * psi) + w.sin * math.sin(w.order * psi) for w in probe.form)
            added = self.probe_added[stream](self.t) if stream in self.probe_added else 0.0
            return np.array([probe.zero + probe.gain * moved + added])
        phi = s.encoder.azimuths[stream[-1]]
        c = d + turn @ np.array(s.encoder.eccentricity)
        ahead = (-c[0] * math.sin(phi) + c[1] * math.cos(phi)) / s.encoder.disc_radius
        psi = phi - theta - ahead  # the mark of the displaced ring that the sight line meets
        angle = theta + ahead
        angle += sum(w.cos * math.cos(w.order * psi) + w.sin * math.sin(w.order * psi) for w in s.encoder.graduation)
        return np.array([angle + self.head_added[stream](self.t, angle) if stream in self.head_added else angle])


def stage_with(**changes):
    """Keyword `encoder_x` replaces x of the encoder, and so on."""
    stage = STAGE
    for name, value in changes.items():
        part, _, key = name.partition("_")
        stage = replace(stage, **{part: replace(getattr(stage, part), **{key: value})})
    return stage


def with_probe(stream, **changes):
    return replace(STAGE, sensors={**STAGE.sensors, stream: replace(STAGE.sensors[stream], **changes)})


def azimuths(letter, by):
    return {**STAGE.encoder.azimuths, letter: STAGE.encoder.azimuths[letter] + by}


ROW = PlanarHarmonic(4, (1e-6, -2e-6), (3e-6, 4e-6))
ORDER = {"order": 4, "x": ROW.x, "y": ROW.y}


def plus(pair, shift):
    return (pair[0] + shift[0], pair[1] + shift[1])


CLOSED_FORMS = {
    "disc_eccentricity": (
        "",
        {"shift": (3e-6, 2e-6)},
        lambda t: Bench(t, stage_with(encoder_eccentricity=plus(STAGE.encoder.eccentricity, (3e-6, 2e-6)))),
    ),
    "graduation_error": (
        "order_7",
        {"order": 7, "cos": 2e-6, "sin": -1e-6},
        lambda t: Bench(t, stage_with(encoder_graduation=(*STAGE.encoder.graduation, AngularHarmonic(7, 2e-6, -1e-6)))),
    ),
    "subdivisional_error": (
        "head_b",
        {"cos": 2e-7, "sin": 3e-7},
        lambda t: Bench(t, head_added={"head_b": lambda _, a: 2e-7 * math.cos(LINES * a) + 3e-7 * math.sin(LINES * a)}),
    ),
    "head_misplacement": (
        "head_c",
        {"azimuth": 0.02},
        lambda t: Bench(t, stage_with(encoder_azimuths=azimuths("c", 0.02))),
    ),
    "head_latency": ("head_d", {"delay": 2e-3}, lambda t: Bench(t, delays={"head_d": 2e-3})),
    "encoder_latency": (
        "",
        {"delay": 2e-3},
        lambda t: Bench(t, delays=dict.fromkeys(("head_a", "head_b", "head_c", "head_d"), 2e-3)),
    ),
    "head_missed_counts": (
        "head_a",
        {"time": 4.0, "step": 2e-5},
        lambda t: Bench(t, head_added={"head_a": lambda now, _: 2e-5 if now >= 4.0 else 0.0}),
    ),
    "disc_scale": ("", {"relative": 0.02}, lambda t: Bench(t, stage_with(encoder_disc_radius=0.1 * 1.02))),
    "autocollimator_gain": (
        "y",
        {"relative": 0.03},
        lambda t: Bench(t, tilt_changed=lambda _, tilt: tilt * np.array([1.0, 1.03])),
    ),
    "autocollimator_roll": (
        "",
        {"angle": 0.05},
        lambda t: Bench(
            t,
            tilt_changed=lambda _, p: np.array(
                [math.cos(0.05) * p[0] + math.sin(0.05) * p[1], -math.sin(0.05) * p[0] + math.cos(0.05) * p[1]]
            ),
        ),
    ),
    "autocollimator_nonlinearity": (
        "",
        {"cubic": 2e6},
        lambda t: Bench(t, tilt_changed=lambda _, tilt: tilt + 2e6 * tilt**3),
    ),
    "autocollimator_drift": (
        "",
        {"rate": (1e-7, -2e-7)},
        lambda t: Bench(t, tilt_changed=lambda now, tilt: tilt + now * np.array([1e-7, -2e-7])),
    ),
    "autocollimator_latency": ("", {"delay": 3e-3}, lambda t: Bench(t, delays={"autocollimator": 3e-3})),
    "mirror_wobble": (
        "",
        {"tilt": (2e-6, -3e-6)},
        lambda t: Bench(t, stage_with(mirror_tilt=plus(STAGE.mirror.tilt, (2e-6, -3e-6)))),
    ),
    "mirror_flatness": (
        "order_4",
        ORDER,
        lambda t: Bench(t, stage_with(mirror_flatness=(*STAGE.mirror.flatness, ROW))),
    ),
    "spindle_radial": ("order_4", ORDER, lambda t: Bench(t, stage_with(spindle_radial=(*STAGE.spindle.radial, ROW)))),
    "spindle_tilt": ("order_4", ORDER, lambda t: Bench(t, stage_with(spindle_tilt=(*STAGE.spindle.tilt, ROW)))),
    "spindle_axial": (
        "order_5",
        {"order": 5, "cos": 2e-7, "sin": -3e-7},
        lambda t: Bench(t, stage_with(spindle_axial=(*STAGE.spindle.axial, AngularHarmonic(5, 2e-7, -3e-7)))),
    ),
    "axial_growth": ("", {"axial": 4e-7}, lambda t: Bench(t, z_added=lambda now: 4e-7 * warming(now))),
    "probe_zero": ("radial_probe_low", {"shift": 2e-6}, lambda t: Bench(t, with_probe("radial_probe_low", zero=1e-6))),
    "probe_gain": ("axial_probe_top", {"relative": 0.1}, lambda t: Bench(t, with_probe("axial_probe_top", gain=-1.65))),
    "probe_drift": (
        "radial_probe_low",
        {"rate": 3e-8},
        lambda t: Bench(t, probe_added={"radial_probe_low": lambda now: 3e-8 * now}),
    ),
    "probe_form": (
        "axial_probe_top.order_4",
        {"order": 4, "cos": 1e-6, "sin": 2e-6},
        lambda t: Bench(
            t, with_probe("axial_probe_top", form=(AngularHarmonic(1, 2e-6, 1e-6), AngularHarmonic(4, 1e-6, 2e-6)))
        ),
    ),
    "tilt_sensor_zero": (
        SECOND,
        {"shift": (2e-6, -1e-6)},
        lambda t: Bench(t, with_probe(SECOND, zero=(2.2e-5, -1.1e-5))),
    ),
    "tilt_sensor_gain": (SECOND, {"relative": 0.1}, lambda t: Bench(t, with_probe(SECOND, gain=-1.32))),
    "tilt_sensor_roll": (SECOND, {"angle": 0.2}, lambda t: Bench(t, with_probe(SECOND, place={"roll": 0.9}))),
    "tilt_sensor_drift": (
        SECOND,
        {"rate": (1e-7, -2e-7)},
        lambda t: Bench(t, probe_added={SECOND: lambda now: now * np.array([1e-7, -2e-7])}),
    ),
    "tilt_sensor_form": (
        f"{SECOND}.order_4",
        ORDER,
        lambda t: Bench(t, with_probe(SECOND, form=(*STAGE.sensors[SECOND].form, ROW))),
    ),
    "bearing_asynchronous": (
        "",
        {"order": 2.37, "radial": 1e-6, "tilt": 2e-6, "phase": 0.7},
        lambda t: Bench(
            t,
            d_added=lambda _, th, turn: 1e-6 * np.array([math.cos(2.37 * th + 0.7), math.sin(2.37 * th + 0.7)]),
            g_added=lambda _, th: 2e-6 * np.array([math.cos(2.37 * th), math.sin(2.37 * th)]),
        ),
    ),
    "load_compliance": (
        "",
        {"radial": 4e-9, "tilt": 1e-8},
        lambda t: Bench(t, stage_with(spindle_radial_compliance=2.4e-8, spindle_tilt_compliance=6e-8)),
    ),
    "thermal_drift": (
        "",
        {"radial": (5e-7, 2e-7)},
        lambda t: Bench(t, stage_with(spindle_radial_thermal=plus(STAGE.spindle.radial_thermal, (5e-7, 2e-7)))),
    ),
    "reversal_backlash": (
        "",
        {"width": 2e-5},
        lambda t: Bench(t, theta_added=lambda now: -1e-5 * math.copysign(1.0, velocity(now))),
    ),
    "radial_hysteresis": (
        "",
        {"radial": (6e-7, -4e-7)},
        lambda t: Bench(t, d_added=lambda now, th, turn: np.array([3e-7, -2e-7]) * math.copysign(1.0, velocity(now))),
    ),
    "following_error": (
        "",
        {"delay": 2e-3},
        lambda t: Bench(t, theta_added=lambda now: command(now - 2e-3) - command(now)),
    ),
    "drive_cyclic_error": (
        "order_30",
        {"order": 30, "cos": 2e-6, "sin": 1e-6},
        lambda t: Bench(
            t, theta_added=lambda now: 2e-6 * math.cos(30 * command(now)) + 1e-6 * math.sin(30 * command(now))
        ),
    ),
    "unbalance": (
        "",
        {"radial": (2e-8, -1e-8)},
        lambda t: Bench(t, d_added=lambda now, th, turn: velocity(now) ** 2 * (turn @ np.array([2e-8, -1e-8]))),
    ),
    "lvdt_gain": (
        "x",
        {"relative": 0.02},
        lambda t: Bench(t, radial_changed=lambda radial: radial * np.array([1.02, 1.0])),
    ),
    "lvdt_artefact": (
        "",
        {"shift": (1e-6, 2e-6)},
        lambda t: Bench(t, stage_with(lvdt_artefact_eccentricity=plus(STAGE.lvdt.artefact_eccentricity, (1e-6, 2e-6)))),
    ),
    "lvdt_height": ("", {"offset": 1e-3}, lambda t: Bench(t, stage_with(lvdt_height=0.061))),
}

EFFECTS = [effect for effect in load_effects(StageEffect) if not effect.name.startswith("angle_sensor_")]
"""Without those of `test_angle_sensors.py`, whose sensors are of no kind that the package has itself."""

PROBES = {f"probe_{what}" for what in ("zero", "gain", "drift", "form")}
TILTS = {f"tilt_sensor_{what}" for what in ("zero", "gain", "roll", "drift", "form")}
STREAMS = ("head_a", "head_b", "head_c", "head_d", "autocollimator", "lvdt", *STAGE.sensors)


@pytest.fixture
def twin():
    inputs = StageInputs(
        command,
        velocity,
        lambda time: np.array([force(t) for t in time]),
        lambda time: np.array([warming(t) for t in time]),
    )
    return StageTwin(STAGE, inputs, dict.fromkeys(STREAMS, TIMES))


def test_every_effect_has_a_closed_form():
    assert {effect.name for effect in EFFECTS} == set(CLOSED_FORMS)


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_effect_agrees_with_its_formula(effect, twin):
    location, parameters, bench = CLOSED_FORMS[effect.name]
    predicted = twin.predict((Cause(effect, location, effect.values_from(parameters)),))
    plain = twin.predict()
    moved = 0.0
    for stream in STREAMS:
        expected = np.array([bench(t).reading(stream) for t in TIMES])
        unmoved = np.array([Bench(t).reading(stream) for t in TIMES])
        np.testing.assert_allclose(predicted[stream], expected, rtol=0, atol=2e-11)
        np.testing.assert_allclose(plain[stream], unmoved, rtol=0, atol=2e-11)
        moved += np.abs(expected - unmoved).max()
        if not effect.touches(location, stream):
            np.testing.assert_array_equal(predicted[stream], plain[stream])
    assert moved > 1e-8, "the example must show the effect"


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_effect_without_size_changes_nothing(effect, twin):
    location = CLOSED_FORMS[effect.name][0]
    plain = twin.predict()
    for stream, values in twin.predict((Cause(effect, location, effect.start(location)),)).items():
        np.testing.assert_allclose(values, plain[stream], rtol=0, atol=1e-14)


def test_effects_of_listed_sensors_are_those_of_stages_that_list_some():
    bare = {effect.name for effect in effects_of(replace(STAGE, sensors={}), EFFECTS)}
    own = {"spindle_axial", "axial_growth"} | PROBES | TILTS
    assert bare == set(CLOSED_FORMS) - own
    for left_out, missing in (("rad", TILTS), ("m", PROBES)):
        sensors = {stream: sensor for stream, sensor in STAGE.sensors.items() if sensor.unit != left_out}
        found = {effect.name for effect in effects_of(replace(STAGE, sensors=sensors), EFFECTS)}
        assert found == set(CLOSED_FORMS) - missing
    assert {effect.name for effect in effects_of(STAGE, EFFECTS)} == set(CLOSED_FORMS)


def test_what_moves_the_axis_touches_sensors_of_any_kind_that_are_listed():
    by_name = {effect.name: effect for effect in EFFECTS}
    for name in ("spindle_radial", "spindle_tilt", "thermal_drift", "load_compliance", "following_error"):
        assert by_name[name].touches("", "radial_probe_low") and by_name[name].touches("", "laser_triangulator_a"), name
    for name in ("mirror_wobble", "disc_eccentricity", "lvdt_gain", "autocollimator_drift", "encoder_latency"):
        assert not by_name[name].touches("", "radial_probe_low"), name
    assert not by_name["probe_form"].touches("radial_probe_low.order_2", "radial_probe_lower")


def test_a_probe_on_the_axis_looks_at_one_spot_and_sees_no_form():
    effect = next(e for e in EFFECTS if e.name == "probe_form")
    top = STAGE.sensors["axial_probe_top"]
    central = replace(STAGE, sensors={**STAGE.sensors, "axial_probe_top": replace(top, place={"radius": 0.0})})
    assert effect.locations(STAGE) == ("axial_probe_top", "radial_probe_low") and effect.locations(central) == (
        "radial_probe_low",
    )


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_report_gives_back_the_parameters(effect):
    _, parameters, _ = CLOSED_FORMS[effect.name]
    values = effect.values_from(parameters)
    reported = effect.report(values, 1e-4 * np.diag(np.square(values)))
    assert set(reported) == set(parameters)
    for name, expected in parameters.items():
        np.testing.assert_allclose(reported[name].value, expected, rtol=1e-12)
        assert np.all(np.asarray(reported[name].std) >= 0)


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_effect_says_what_it_is(effect):
    location, parameters, _ = CLOSED_FORMS[effect.name]
    assert effect.title and effect.source
    assert all(parameter.unit and parameter.scale > 0 for parameter in effect.parameters)
    assert place_of(location) in effect.locations(STAGE)
    assert np.all(np.abs(effect.values_from(parameters)) <= [p.bound for p in effect.parameters for _ in range(p.size)])


def test_asynchronous_phase_and_size_spread_as_their_parts():
    effect = next(e for e in EFFECTS if e.name == "bearing_asynchronous")
    values = effect.values_from({"order": 2.4, "radial": 3e-7, "tilt": 1e-6, "phase": 0.4})
    rng = np.random.default_rng(5)
    std = np.array([1e-4, 3e-9, 3e-9, 1e-8])
    drawn = values + std * rng.normal(size=(20000, 4))
    reported = effect.report(values, np.diag(np.square(std)))
    assert reported["radial"].std == pytest.approx(np.hypot(drawn[:, 1], drawn[:, 2]).std(), rel=0.03)
    assert reported["phase"].std == pytest.approx(np.arctan2(drawn[:, 2], drawn[:, 1]).std(), rel=0.03)


@pytest.mark.parametrize("late", ["autocollimator_latency", "encoder_latency"])
def test_a_late_sensor_sees_the_lag_of_the_drive_as_well(late, twin):
    by_name = {effect.name: effect for effect in EFFECTS}
    causes = [Cause(by_name[late], "", np.array([3e-3])), Cause(by_name["following_error"], "", np.array([2e-3]))]
    stream = "autocollimator" if late == "autocollimator_latency" else "head_b"
    bench = [Bench(t, theta_added=lambda now: command(now - 2e-3) - command(now), delays={stream: 3e-3}) for t in TIMES]
    expected = np.array([b.reading(stream) for b in bench])
    np.testing.assert_allclose(twin.predict(causes)[stream], expected, rtol=0, atol=2e-11)


@pytest.mark.parametrize("part_of_a_line", [1e-4, 0.1, 0.5, 0.73, 0.9, 0.99])
@pytest.mark.parametrize("phase", [0.0, 0.7, 2.9, -1.8])
def test_an_error_within_lines_is_taken_off_the_reading_however_steep_it_is(part_of_a_line, phase):
    """The reading is still a function of the angle as long as the error is less than a radian of its own period."""
    effect = next(e for e in load_effects(StageEffect) if e.name == "subdivisional_error")
    amplitude = part_of_a_line / LINES
    values = amplitude * np.array([math.cos(phase), math.sin(phase)])
    angle = np.linspace(-0.05, 4.0, 20_000)
    reading = angle + values[0] * np.cos(LINES * angle) + values[1] * np.sin(LINES * angle)
    far = np.zeros_like(angle)
    state = RotorState(far, far, far, far, np.zeros((len(far), 2)), far, lambda t: 0.0 * t, LINES, observed=reading)
    np.testing.assert_allclose(effect.measured(values, "head_a", state, angle), reading, atol=1e-9 * amplitude + 1e-14)
