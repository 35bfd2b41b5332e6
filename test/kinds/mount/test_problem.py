"""Diagnosis of mounts: exact geometry made elsewhere, and three real mounts against the sky."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from draws import seeds
from simulated_pointings import LATITUDE, Pointings, pointing_file, simulate_pointings

from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.kinds.mount.course import TimeCourses
from rotary_error_monitor.kinds.mount.description import MountDescription, load_mount
from rotary_error_monitor.kinds.mount.effects import MountEffect
from rotary_error_monitor.kinds.mount.pointings import parse_pointings, read_pointings
from rotary_error_monitor.kinds.mount.problem import MountProblem
from rotary_error_monitor.kinds.mount.sky import BLOCKS, estimate_repeatability, sky_conditions, sky_patches

ROOT = Path(__file__).parents[3]
REAL = ROOT.parent / "shared" / "real" / "telescope_two_axis_pointing"
EFFECTS = load_effects(MountEffect)
MOUNT = MountDescription("mount", 5e-6)
real = pytest.mark.skipif(not REAL.is_dir(), reason="no real pointings beside the checkout (../shared/real)")


def problem_of(simulated, effects=EFFECTS):
    return MountProblem(MOUNT, parse_pointings(pointing_file(simulated), "made"), effects)


def tube_sags(size):
    return lambda pose: size * np.cross(pose.tube, -pose.up)


def axis_slips(rate):
    return lambda pose: rate * pose.time[:, None] * pose.declination


def wheel_is_eccentric(cos, sin):
    def turn(pose):
        hour = pose.readings[:, 0]
        return -(cos * np.cos(hour) + sin * np.sin(hour))[:, None] * pose.polar

    return turn


def both(*turns):
    return lambda pose: sum(turn(pose) for turn in turns)


def test_the_file_gives_back_what_was_written():
    made = simulate_pointings(1)
    stars, readings, sidereal = made.stars, made.readings, made.sidereal
    recording = parse_pointings(pointing_file(made), "made")
    assert recording.latitude == pytest.approx(LATITUDE, abs=1e-12)
    np.testing.assert_allclose(np.exp(1j * recording.readings), np.exp(1j * readings), rtol=0, atol=1e-7)
    np.testing.assert_allclose(np.exp(1j * recording.stars), np.exp(1j * stars), rtol=0, atol=1e-7)
    np.testing.assert_allclose(np.diff(recording.time), np.diff(sidereal) * 86164.09 / (2 * np.pi), rtol=0, atol=2e-3)
    np.testing.assert_array_equal(recording.direction[1:], np.sign(np.diff(readings, axis=0)))


@pytest.mark.parametrize("seed", range(4))
def test_a_rigid_mount_has_no_gap_however_it_is_set_up(seed):
    rng = np.random.default_rng(seed)
    geometry = (rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3), *rng.normal(0, 0.01, 4))
    problem = problem_of(simulate_pointings(seed, geometry=geometry))
    diagnosis = diagnose(problem)
    assert diagnosis.verdict is Verdict.NO_GAP
    np.testing.assert_allclose(problem.settled(()).as_tuple(), geometry, rtol=0, atol=6e-5)
    assert problem.std == pytest.approx(5e-5, rel=0.25)


CASES = {
    "tube_flexure": (tube_sags(1.5e-3), {("tube_flexure", ""): {"sag": 1.5e-3}}),
    "axis_slip": (axis_slips(2e-7), {("axis_slip", "D"): {"rate": 2e-7}}),
    "axis_eccentricity": (
        wheel_is_eccentric(3e-4, 9e-4),
        {("axis_eccentricity", "H"): {"cos": 3e-4, "sin": 9e-4}},
    ),
    "tube and slip": (
        both(tube_sags(-8e-4), axis_slips(1e-7)),
        {("tube_flexure", ""): {"sag": -8e-4}, ("axis_slip", "D"): {"rate": 1e-7}},
    ),
}


@pytest.mark.parametrize("name", sorted(CASES))
def test_the_cause_is_found_and_sized(name):
    turn, expected = CASES[name]
    diagnosis = diagnose(problem_of(simulate_pointings(7, turn=turn)))
    assert diagnosis.verdict is Verdict.EXPLAINED
    assert {found.cause.key for found in diagnosis.causes} == set(expected)
    for found in diagnosis.causes:
        for parameter, value in expected[found.cause.key].items():
            estimate = found.parameters[parameter]
            assert estimate.value == pytest.approx(value, abs=4 * estimate.std)
            assert estimate.std < 0.1 * max(abs(v) for v in expected[found.cause.key].values())
    figures = diagnosis.figures
    assert figures["held_out_causes_arcsec"] == pytest.approx(np.hypot(5e-5, 5e-5) * 206265, rel=0.2)
    assert figures["held_out_causes_arcsec"] < figures["held_out_geometry_arcsec"] < figures["held_out_indices_arcsec"]


def test_an_effect_that_is_not_known_is_not_named():
    unknown = tuple(effect for effect in EFFECTS if effect.name not in ("axis_slip", "settling_ground"))
    diagnosis = diagnose(problem_of(simulate_pointings(7, turn=axis_slips(4e-7)), unknown))
    assert diagnosis.verdict in (Verdict.UNKNOWN, Verdict.PARTLY_EXPLAINED)
    assert diagnosis.gap.shrink < 0.5
    assert any("time" in finding.pattern for finding in diagnosis.remainder)


def test_effects_that_no_pointing_tells_apart_are_said_to_be():
    """To first order a sagging declination axis is an eccentric hour wheel beside an axis out of square."""

    def sags(pose):
        return 2e-3 * np.cross(pose.declination, -pose.up)

    diagnosis = diagnose(problem_of(simulate_pointings(11, turn=sags)))
    (group,) = diagnosis.indistinguishable
    assert {key[0] for key in group.effects} >= {"declination_axis_flexure", "axis_eccentricity"}
    assert "no pointings that were tried" in group.advice


def test_backlash_needs_the_direction_of_travel():
    def lags(pose):
        way = np.sign(np.diff(pose.readings[:, 1], prepend=pose.readings[0, 1]))
        return -2e-4 * way[:, None] * pose.declination

    (found,) = diagnose(problem_of(simulate_pointings(5, turn=lags))).causes
    assert found.cause.key == ("axis_backlash", "D")
    assert found.parameters["width"].value == pytest.approx(4e-4, rel=0.1)


def about_declination(course):
    """A turn about the declination axis, rad, as a function of time from 0 to 1."""

    def turn(pose):
        time = (pose.time - pose.time.min()) / np.ptp(pose.time)
        return course(time)[:, None] * pose.declination

    return turn


def test_an_axis_that_jumps_once_does_not_slip_steadily():
    """Neighbours on the sky do not share the jump: what a slip leaves of it passed for noise."""
    for seed in seeds(4):
        at = np.random.default_rng(seed).uniform(0.2, 0.8)
        jumps = about_declination(lambda time, at=at: 5e-4 * (time > at))
        diagnosis = diagnose(problem_of(simulate_pointings(seed, turn=jumps)))
        assert diagnosis.verdict in (Verdict.UNKNOWN, Verdict.PARTLY_EXPLAINED)
        assert any("time" in finding.pattern for finding in diagnosis.remainder)


def test_what_swings_with_time_is_no_noise():
    swings = about_declination(lambda time: 5e-4 * np.sin(12 * time))
    diagnoses = [diagnose(problem_of(simulate_pointings(seed, turn=swings))) for seed in seeds(3)]
    assert all(diagnosis.verdict in (Verdict.UNKNOWN, Verdict.PARTLY_EXPLAINED) for diagnosis in diagnoses)


def test_noise_as_loud_as_neighbours_on_the_sky_say_where_nothing_stands_out_over_time():
    """Noise of which a pointing keeps half of that before it is coloured, three times white where it is slow."""
    lowered = 0
    for seed in seeds(4):
        rng = np.random.default_rng(seed)
        count, noise = 300, rng.normal(size=(300, 2))
        for i in range(1, count):
            noise[i] = 0.5 * noise[i - 1] + np.sqrt(0.75) * noise[i]
        courses = TimeCourses(np.arange(count) * 100.0, rng.choice([-1.0, 1.0], count))
        lowered += np.count_nonzero(courses.noise(noise, np.ones(2), np.ones(count, bool)) < 1.0)
    assert lowered <= 2, "of eight components, one in a hundred by chance"


def test_patches_hold_equal_numbers_and_all_pointings():
    readings = np.random.default_rng(0).uniform(-1, 1, (98, 2))
    patches = sky_patches(readings)
    assert len(patches) == BLOCKS
    assert sorted(np.concatenate(patches)) == list(range(98))
    assert {len(patch) for patch in patches} <= {4, 5}
    width = np.mean([np.prod(np.ptp(readings[patch], axis=0)) for patch in patches])
    assert width < 4 / BLOCKS, "a patch is a place, not a random draw"
    pieces = sky_conditions(patches).pieces("hour", np.arange(98.0), 0)
    assert [piece.stop - piece.start for _, piece in pieces] == [len(patch) for patch in patches]


def test_repeatability_is_noise_without_what_is_smooth():
    rng = np.random.default_rng(2)
    places = rng.uniform(-1, 1, (400, 3))
    smooth = 50 * np.column_stack([np.sin(places[:, 0]), places[:, 1] * places[:, 2]])
    errors = smooth + rng.normal(0, [1.0, 3.0], (400, 2))
    errors[17] += 300
    std, kept = estimate_repeatability(errors, places)
    assert std == pytest.approx([1.6, 3.2], rel=0.5)
    assert not kept[17] and kept.sum() >= 396


HEAD = "!x\n:EQUAT\n"
SITE = "+39 00 25 2026 1 1 10.0 990.0 200.0 0.5 0.55 0.0065\n"
LINE = "01 00 00 +10 00 00 01 00 10 +10 01 00 02 30.000\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEAD, "no line of the site"),
        (HEAD + SITE + LINE * 5, "5 pointings; at least 30"),
        (HEAD + SITE + LINE * 40 + "1 2 3\n", r"made:44: 3 fields; a pointing .* has 14"),
        (HEAD + SITE + LINE.replace("+10 00 00", "+95 00 00") * 40, r"made:4: \+95 00 00 as declination of the star"),
        (HEAD + SITE + LINE.replace("30.000", "x") * 40, "made:4: 'x' is no number"),
        (HEAD + SITE + LINE.replace("30.000", "nan") * 40, "made:4: .*expected finite"),
        (":ALTAZ\n" + SITE + LINE * 40, "made:1: option :ALTAZ; only equatorial"),
        (HEAD + "+39 00 25\n" + LINE * 40, "made:3: 3 fields; the site"),
        (HEAD + SITE.replace("990.0", "99000") + LINE * 40, "made:3: 99000 in field 8 .* expected the pressure in hPa"),
        (HEAD + SITE.replace("10.0", "283.0") + LINE * 40, "made:3: 283 in field 7 .* temperature in °C, -90 to 60"),
        (HEAD + SITE.replace(" 0.5 ", " 50 ") + LINE * 40, "made:3: 50 in field 10 .* relative humidity, 0 to 1"),
        (HEAD + SITE.replace("0.55", "550") + LINE * 40, "made:3: 550 in field 11 .* wavelength in µm"),
        (
            HEAD + SITE + LINE.replace("+10 01", "+10 71") * 40,
            r"made:4: 71 in \+10 71 00; expected minutes from 0 to 60",
        ),
        (HEAD + SITE + LINE * 40, "1 of 40 pointings differ from one another; at least 30 must"),
    ],
)
def test_wrong_files_are_told_with_their_line(text, message):
    with pytest.raises(InputError, match=message):
        parse_pointings(text, "made")


def test_a_file_of_another_kind_of_mount_is_refused():
    made = simulate_pointings(3)
    mixed = Pointings(np.random.default_rng(0).permutation(made.stars), made.readings, made.sidereal)
    with pytest.raises(InputError, match="not of an equatorial mount"):
        diagnose(problem_of(mixed))


@pytest.mark.parametrize(("count", "pressure"), [(160, 0.0), (160, 1010.0), (40, 1010.0)])
def test_stars_below_the_horizon_are_told(count, pressure):
    southern = replace(MOUNT, latitude=-LATITUDE)
    recording = parse_pointings(pointing_file(simulate_pointings(3, count), pressure), "made")
    with pytest.raises(InputError, match=rf"of {count} stars stand below the horizon at the latitude of -39.0°"):
        diagnose(MountProblem(southern, recording, EFFECTS))


def lifted_by_air(pose):
    """What air does near the horizon as well, of 1010 hPa and 10 °C, without its sign: the star stands lower.

    Bennett 1982 (J. Navigation 35, 255), with his second term: within 0.9″ of Garfinkel's theory down to the horizon.
    """
    altitude = np.degrees(np.arcsin(np.sum(pose.tube * pose.up, axis=1)))
    minutes = 1 / np.tan(np.radians(altitude + 7.31 / (altitude + 4.4)))
    minutes -= 0.06 * np.sin(np.radians(14.7 * minutes + 13))
    across = np.cross(pose.tube, -pose.up)
    size = np.radians(np.where(altitude > 0, minutes, 0.0) / 60)
    return size[:, None] * across / np.linalg.norm(across, axis=1, keepdims=True)


def test_stars_near_the_horizon_are_no_other_refraction():
    """Two terms do not hold there, and what they miss is no weather."""
    told = []
    for seed in seeds(9, 3100):
        made = simulate_pointings(seed, 300, turn=lifted_by_air)
        altitude = np.arcsin(
            np.sin(LATITUDE) * np.sin(made.stars[:, 1])
            + np.cos(LATITUDE) * np.cos(made.stars[:, 1]) * np.cos(made.stars[:, 0])
        )
        above = altitude > 0
        made = Pointings(made.stars[above], made.readings[above], made.sidereal[above])
        low = int(np.count_nonzero(altitude[above] < np.radians(5.0)))
        problem = MountProblem(MOUNT, parse_pointings(pointing_file(made, 1010.0), "made"), EFFECTS)
        diagnosis = diagnose(problem)
        said = f"{low} of {len(made.stars)} pointings are lower than 5°, where refraction is not known well enough"
        assert any(said in remark for remark in diagnosis.remarks), (said, diagnosis.remarks)
        told.append(diagnosis.verdict)
    assert told.count(Verdict.NO_GAP) >= len(told) - 1, told


def test_pointings_at_the_horizon_alone_are_refused():
    made = simulate_pointings(4, 6000, turn=lifted_by_air)
    sine = np.sin(LATITUDE) * np.sin(made.stars[:, 1])
    sine += np.cos(LATITUDE) * np.cos(made.stars[:, 1]) * np.cos(made.stars[:, 0])
    low = (sine > 0) & (sine < np.sin(np.radians(5.2)))
    made = Pointings(made.stars[low], made.readings[low], made.sidereal[low])
    with pytest.raises(InputError, match=r"pointings are lower than 5°.* at least 30 others are needed"):
        diagnose(MountProblem(MOUNT, parse_pointings(pointing_file(made, 1010.0), "made"), EFFECTS))


@real
@pytest.mark.parametrize(
    ("file", "twin", "count"),
    [("gem-28", "gem_28", 454), ("cgx-l-data", "cgx_l", 148), ("warp-astron", "warp_astron", 98)],
)
def test_real_mounts_agree_with_a_plain_pointing_model(file, twin, count):
    """The geometry's residual against ordinary least squares on the textbook's six first-order terms."""
    recording = read_pointings(REAL / f"{file}.dat")
    assert len(recording.time) == count
    # Noise far above what the mount shows: both ways count alike, as in the textbook.
    mount = replace(load_mount(ROOT / "config" / "mounts" / f"{twin}.yaml"), noise=5e-3)
    problem = MountProblem(mount, recording, EFFECTS)
    exact = problem.error(()) * 206265
    assert np.hypot(*exact)[problem.kept].size >= 0.9 * count
    exact_rms = np.sqrt(np.mean(np.sum(np.square(exact), axis=0)))
    assert 0.94 * textbook_rms(problem) < exact_rms < 1.01 * textbook_rms(problem), (
        "tilts of a degree are not of first order"
    )


def textbook_rms(problem):
    """Root mean square on the sky, arcsec, of six linear terms (Wallace 2002) about the mean index."""
    recording = problem.recording
    seen_h, seen_d = angles_of(problem.twin.seen, problem.twin.latitude)
    other = np.cos(recording.readings[:, 1]) < 0
    hour = recording.readings[:, 0] - np.pi * other
    declination = np.where(other, np.pi - recording.readings[:, 1], recording.readings[:, 1])
    index = np.angle(np.mean(np.exp(1j * (seen_h - hour))))
    side, hour = np.where(other, -1.0, 1.0), hour + index
    offset = np.mean(side * (seen_d - declination))
    declination = declination + side * offset
    left = np.concatenate([np.angle(np.exp(1j * (seen_h - hour))) * np.cos(seen_d), seen_d - declination])
    h, d, nothing = seen_h, seen_d, np.zeros(len(seen_h))
    terms = [
        (np.cos(d), nothing),
        (nothing, side),
        (side, nothing),
        (side * np.sin(d), nothing),
        (-np.cos(h) * np.sin(d), np.sin(h)),
        (np.sin(h) * np.sin(d), np.cos(h)),
    ]
    weight = np.repeat(1 / problem.std, len(h)) * np.tile(problem.kept, 2)
    table = np.stack([np.concatenate(term) for term in terms], axis=1)
    fitted, *_ = np.linalg.lstsq(table * weight[:, None], left * weight, rcond=None)
    return float(np.sqrt(np.sum(np.square(left - table @ fitted)) / len(h)) * 206265)


def angles_of(direction, latitude):
    south, east, up = direction
    return (
        np.arctan2(-east, np.sin(latitude) * south + np.cos(latitude) * up),
        np.arcsin(np.sin(latitude) * up - np.cos(latitude) * south),
    )
