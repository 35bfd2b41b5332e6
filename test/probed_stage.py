"""Recordings of a stage with displacement probes, written out with numpy alone: nothing here knows the package's twin.

The rotor turns as commanded but for its jitter. Its axis moves by (x, y, z) and leans by (a, b), sums of waves over the
rotation. A head at azimuth phi sees where its sight line cuts the displaced ring, the autocollimator how the mirror
leans, a radial probe how far the artefact at its height stands out towards it, an axial probe how high the face stands
where it looks.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.signal import lfilter

from rotary_error_monitor.description.harmonics import AngularHarmonic, PlanarHarmonic
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.description.spindle_section import Spindle
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.stage_section import Encoder, Mirror
from rotary_error_monitor.description.two_axis_section import Autocollimator
from rotary_error_monitor.signals.blocks import block_from_samples

START = 1_763_700_000_000_000_000
SECONDS = 16.0
SPEEDS = (2.0, 4.0, -4.0, -2.0)
"""Commanded one after the other, rad/s, each for a quarter of a recording of `SECONDS`; together they lead back."""

TOP, LOW, HIGH = "axial_probe_top", "radial_probe_low", "radial_probe_high"

STAGE = StageDescription(
    encoder=Encoder(
        disc_radius=0.1,
        lines_per_revolution=31488,
        counts_per_line=400,
        noise=3e-7,
        azimuths={"a": 0.0, "b": np.pi, "c": np.pi / 2, "d": 1.5 * np.pi},
        eccentricity=(4e-6, -3e-6),
        graduation=(AngularHarmonic(2, 1e-6, -5e-7),),
    ),
    autocollimator=Autocollimator(range=5e-4, resolution=5e-8, noise=2e-7),
    mirror=Mirror(tilt=(3e-5, 1e-5)),
    spindle=Spindle(
        radial=(PlanarHarmonic(2, (4e-7, 1e-7), (-1e-7, 3e-7)),),
        tilt=(PlanarHarmonic(2, (1e-6, -5e-7), (5e-7, 1e-6)),),
        axial=(AngularHarmonic(1, 1e-7, 5e-8),),
    ),
    sensors={
        TOP: ListedSensor("axial_probe", 8e-9, 1e-9, 1e-4, 2e-7, zero=1e-6, place={"azimuth": 0.3, "radius": 0.02}),
        LOW: ListedSensor(
            "radial_probe",
            1e-8,
            1e-9,
            1e-4,
            2e-7,
            gain=-1.0,
            place={"azimuth": 0.0, "height": 0.04},
            form=(AngularHarmonic(1, 2e-6, -1e-6), AngularHarmonic(2, 3e-7, 1e-7)),
        ),
        HIGH: ListedSensor("radial_probe", 3e-8, 1e-9, 1e-4, 2e-7, place={"azimuth": 1.1, "height": 0.16}),
    },
)

SECOND = "tilt_sensor_second"
WITH_SECOND = replace(
    STAGE,
    sensors={
        SECOND: ListedSensor(
            "tilt_sensor",
            *(2e-7, 5e-8, 5e-4, 5e-7),
            zero=(2e-5, -1e-5),
            gain=-1.0,
            place={"roll": 0.6},
            form=(PlanarHarmonic(1, (2e-5, -1e-5), (1e-5, 2e-5)),),
            fields=("tilt_x", "tilt_y"),
            unit="rad",
        )
    },
)


@dataclass(frozen=True)
class Withheld:
    """What the stage has and the twin does not know: rows (order, cos, sin) or (order, (x, x), (y, y)), m or rad."""

    radial: tuple = ()
    tilt: tuple = ()
    axial: tuple = ()
    form: dict = field(default_factory=dict)
    zero: dict = field(default_factory=dict)
    gain: dict = field(default_factory=dict)
    roll: dict = field(default_factory=dict)
    drift: dict = field(default_factory=dict)
    growth: float = 0.0
    noise: dict = field(default_factory=dict)


def command(time):
    """(n, 2) angle and speed; after all speeds the rotor is back where it began, and does the same again."""
    each, since = SECONDS / len(SPEEDS), np.mod(time, SECONDS)
    edges = each * np.arange(len(SPEEDS) + 1)
    speed = np.asarray(SPEEDS)[(since / each).astype(int)]
    return np.stack([np.interp(since, edges, np.concatenate([[0.0], np.cumsum(SPEEDS) * each])), speed], axis=1)


def waves(rows, angle):
    return sum((c * np.cos(k * angle) + s * np.sin(k * angle) for k, c, s in rows), np.zeros(len(angle)))


def rows_of(harmonics):
    return [(row.order, row.cos, row.sin) for row in harmonics]


def plane(harmonics, extra, theta):
    """x and y of waves that are described and of those that are withheld."""
    rows = [(row.order, row.x, row.y) for row in harmonics] + list(extra)
    return [waves([(row[0], *row[part]) for row in rows], theta) for part in (1, 2)]


def recorded(seed, withheld=Withheld(), stage=STAGE, seconds=SECONDS):
    """Sample blocks by topic of the stage as it is: zero and form of each probe as uncertain as the twin says."""
    rng = np.random.default_rng(seed)
    fine = np.arange(0.0, seconds, 1e-3)
    # As an inertia does it: power falls with the fourth power of the frequency above some hertz.
    kept = np.exp(-2 * np.pi * 4.0 * 1e-3)
    jitter = lfilter([1.0], [1.0, -2 * kept, kept**2], rng.normal(size=len(fine)))
    jitter *= 1.5e-6 / jitter.std()

    def state(rate, late):
        time = np.arange(late, seconds, 1.0 / rate)
        theta = command(time)[:, 0] + np.interp(time, fine, jitter)
        x, y = plane(stage.spindle.radial, withheld.radial, theta)
        a, b = plane(stage.spindle.tilt, withheld.tilt, theta)
        return time, theta, x, y, a, b

    def read(exact, noise, step):
        return step * np.rint((exact + noise * rng.normal(size=exact.shape)) / step)

    encoder, streams = stage.encoder, {}
    for letter, phi in stage.azimuths.items():
        time, theta, x, y, *_ = state(250.0, 0.0)
        ex, ey = encoder.eccentricity
        x, y = x + ex * np.cos(theta) - ey * np.sin(theta), y + ex * np.sin(theta) + ey * np.cos(theta)
        ahead = np.arcsin((-x * np.sin(phi) + y * np.cos(phi)) / encoder.disc_radius)
        exact = theta + ahead + waves(rows_of(encoder.graduation), phi - theta - ahead)
        streams[f"head_{letter}"] = (time, ("angle",), read(exact, encoder.noise, encoder.resolution)[:, None])
    if stage.autocollimator is not None:
        time, theta, _, _, a, b = state(50.0, 1.3e-3)
        tx, ty = stage.mirror.tilt
        lean = np.stack([a + tx * np.cos(theta) - ty * np.sin(theta), b + tx * np.sin(theta) + ty * np.cos(theta)], 1)
        instrument = stage.autocollimator
        streams["autocollimator"] = (time, ("tilt_x", "tilt_y"), read(lean, instrument.noise, instrument.resolution))
    for name, probe in stage.sensors.items():
        time, theta, x, y, a, b = state(100.0, 0.7e-3)
        if probe.kind == "tilt_sensor":
            streams[name] = (
                time,
                probe.fields,
                read(tilted(name, probe, withheld, rng, time, theta, a, b), probe.noise, probe.resolution),
            )
            continue
        phi = probe.place["azimuth"]
        if probe.kind == "axial_probe":
            at = probe.place["radius"] * np.array([np.cos(phi), np.sin(phi)])
            z = waves([*rows_of(stage.spindle.axial), *withheld.axial], theta) + withheld.growth * warming(time)
            moved = z + a * at[1] - b * at[0]
        else:
            height = probe.place["height"]
            moved = (x + height * b) * np.cos(phi) + (y - height * a) * np.sin(phi)
        form = [*rows_of(probe.form), *withheld.form.get(name, ())]
        form += [
            (k, *(probe.uncertainty * rng.normal(size=2))) for k in sorted({1, *(row.order for row in probe.form)})
        ]
        zero = probe.zero + probe.uncertainty * rng.normal() + withheld.zero.get(name, 0.0)
        gain = probe.gain * (1 + withheld.gain.get(name, 0.0))
        exact = zero + gain * (moved + waves(form, phi - theta)) + withheld.drift.get(name, 0.0) * time
        noise = probe.noise * withheld.noise.get(name, 1.0)
        streams[name] = (time, ("displacement",), read(exact, noise, probe.resolution)[:, None])
    time = np.arange(0.0, seconds, 5e-3)
    streams["command"] = (time, ("angle", "velocity"), command(time))
    time = np.arange(0.0, seconds + 0.5, 1.0)
    streams["temperature"] = (
        time,
        ("temperature",),
        20.0 + warming(time)[:, None] + 1e-3 * rng.normal(size=(len(time), 1)),
    )
    return streams


def tilted(name, sensor, withheld, rng, time, theta, a, b):
    """(n, 2) what another autocollimator shows of a mirror of its own: turned by its roll, then scaled and shifted."""
    uneven = [(row.order, row.x, row.y) for row in sensor.form] + list(withheld.form.get(name, ()))
    uneven += [
        (order, *(tuple(sensor.uncertainty * rng.normal(size=2)) for _ in "xy"))
        for order in sorted({1, *(row.order for row in sensor.form)})
    ]
    x, y = (part + waves([(row[0], *row[axis]) for row in uneven], theta) for axis, part in ((1, a), (2, b)))
    roll = sensor.place["roll"] + withheld.roll.get(name, 0.0)
    along = np.stack([np.cos(roll) * x - np.sin(roll) * y, np.sin(roll) * x + np.cos(roll) * y], axis=1)
    zero = np.array(sensor.zero) + sensor.uncertainty * rng.normal(size=2) + np.array(withheld.zero.get(name, 0.0))
    gain = sensor.gain * (1 + withheld.gain.get(name, 0.0))
    return zero + gain * along + time[:, None] * np.array(withheld.drift.get(name, (0.0, 0.0)))


def warming(time):
    """K above the reference: it comes and goes, as nothing else here does."""
    return 0.4 * np.sin(2 * np.pi * time / SECONDS) ** 2


def blocks_of(streams):
    """One block of samples for each stream."""
    return {
        name: [block_from_samples(START + np.rint(time * 1e9).astype(np.int64), fields, values)]
        for name, (time, fields, values) in streams.items()
    }


def without_autocollimator(stage=STAGE):
    return replace(stage, autocollimator=None)


AROUND = tuple(f"radial_probe_{name}" for name in ("one", "two", "three"))


def without_heads(stage=STAGE):
    """Three radial probes at 120° before one artefact in place of heads and autocollimator."""
    probe = ListedSensor("radial_probe", 1e-8, 1e-9, 1e-4, 2e-7, form=(AngularHarmonic(1, 2e-6, -1e-6),))
    probes = {
        name: replace(probe, place={"azimuth": 0.4 + 2 * np.pi * place / 3, "height": 0.0})
        for place, name in enumerate(AROUND)
    }
    return replace(stage, encoder=None, autocollimator=None, sensors=dict(sorted(probes.items())))
