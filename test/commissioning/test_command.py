"""The command `commission`: what it says, writes and refuses, and that the estimator is right by its file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from described_stages import stage_of
from draws import seeds
from world.newly_built import NewlyBuilt, build, in_unit, mirrored
from world.recording import COMMAND, Recording, head_topic

from commissioning.bags import run, written
from rotary_error_monitor.commissioning.stage_file import commission_stage
from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.recordings.replay import replay_bag
from rotary_error_monitor.resources import config
from rotary_error_monitor.signals.blocks import SampleBlock

DURATION = 24.0
"""Of a recording, s: a turn each way, whatever is drawn."""


def motion_error(
    built: NewlyBuilt, bag: Path, stage: StageDescription, later_ns: int = 0, height: float = 0.0, fewest: int = 1
) -> float:
    """Root mean square of the error of the radial error motion, beside what turns with the rotor, m.

    As `motion_errors`.
    """
    return motion_errors(built, bag, stage, later_ns, height, fewest)[0]


def motion_errors(
    built: NewlyBuilt, bag: Path, stage: StageDescription, later_ns: int, height: float, fewest: int
) -> tuple[float, float, float]:
    """Errors of the radial error motion at a height above the ring, beside what turns with the rotor, m.

    Stamps of the bag are `later_ns` later than those of the recording, beyond which nothing is judged; `fewest`
    estimates must be there. Given are the root mean square, the same beside what goes against the rotor once a turn,
    and the amplitude of that: an azimuth that is off makes it of the eccentricity.
    """
    found = replay_bag(bag, stage)
    stamps = found.stamp_ns - later_ns
    begin = built.recording.start_ns
    recorded = (stamps > begin) & (stamps < begin + round(built.recording.duration * 1e9))
    motion = found.error_motion[recorded]
    truth = built.recording.truth(stamps[recorded])
    seen = np.isfinite(motion[:, [0, 1, 3, 4] if height else [0, 1]]).all(axis=1)
    assert seen.mean() > 0.9 and seen.sum() >= fewest
    shown = motion[seen, 0] + 1j * motion[seen, 1]
    true = (truth.exc + 1j * truth.eyc)[seen]
    if height:
        shown = shown + height * (motion[seen, 4] - 1j * motion[seen, 3])
        true = true + height * (truth.ebc - 1j * truth.eac)[seen]
    # x is the direction of the described azimuths, which stand up to 2° from the true ones
    heads = built.true["encoder"]["heads"]
    off = np.array([stage.azimuths[name] - head["azimuth"] for name, head in heads.items()])
    turn = (off - 2 * np.pi * np.rint(off / (2 * np.pi))).mean()
    # eccentricity and what of the rotor's own order 1 goes round with it are one, and so are offset and zeros
    design = np.stack([np.ones(seen.sum()), np.exp(1j * truth.theta[seen])], axis=1)
    error = shown - true * np.exp(1j * turn)
    left = error - design @ np.linalg.lstsq(design, error, rcond=None)[0]
    against = np.column_stack([design, np.exp(-1j * truth.theta[seen])])
    found_against = np.linalg.lstsq(against, error, rcond=None)[0]
    sizes = [float(np.sqrt(np.mean(np.abs(each) ** 2))) for each in (left, error - against @ found_against)]
    return sizes[0], sizes[1], float(abs(found_against[2]))


def check_errors(
    built: NewlyBuilt,
    true: StageDescription,
    bag: Path,
    stage: StageDescription,
    later_ns: int = 0,
    height: float = 0.0,
    fewest: int = 1,
) -> None:
    """With a file that was written the estimator is right to 0.1 µm, beside the noise that the `true` file leaves.

    Beside order 1: what of it goes round with the rotor is one with the eccentricity, and what goes against it may as
    well come of azimuths that are off, as far as these are uncertain. As `motion_errors` otherwise.
    """
    whole, error, against = motion_errors(built, bag, stage, later_ns, height, fewest)
    _, noise, _ = motion_errors(built, bag, true, later_ns, height, fewest)
    um = [f"{each * 1e6:.3f}" for each in (error, noise, against, whole)]
    print(
        f"at {height} m: error {um[0]} µm, with a true file {um[1]}; against the rotor {um[2]}, with it in all {um[3]}"
    )
    assert error < np.hypot(noise, 0.1e-6)
    # sin and cos of an azimuth change by as much as it is off, and an eccentricity of e seems another by e times that
    eccentricity = np.hypot(*built.true["encoder"]["eccentricity"])
    assert against < 4 * stage.uncertainty["encoder.azimuth"] * eccentricity


def test_instruments_that_the_file_lists_as_sensors_are_commissioned_there(tmp_path: Path) -> None:
    bag, nominal = written(build(7, count=4, even=False, swap=False, known_tilt=True, duration=DURATION), tmp_path)
    assert run(bag, nominal, tmp_path / "sections.yaml") == 0
    stage = yaml.safe_load(nominal.read_text(encoding="utf-8"))["stage"]
    heads = {name: {"kind": "read_head", **row} for name, row in stage["encoder"].pop("heads").items()}
    listed = {**heads, "level": {"kind": "autocollimator", **stage.pop("autocollimator")}}
    listed["drive"] = {"kind": "command", **stage.pop("command", {})}
    (tmp_path / "listed_nominal.yaml").write_text(yaml.safe_dump({"stage": {**stage, "sensors": listed}}))
    assert run(bag, tmp_path / "listed_nominal.yaml", tmp_path / "listed.yaml") == 0
    assert load_stage(tmp_path / "listed.yaml") == load_stage(tmp_path / "sections.yaml") != load_stage(nominal)
    left = yaml.safe_load((tmp_path / "listed.yaml").read_text(encoding="utf-8"))["stage"]
    assert "heads" not in left["encoder"] and "autocollimator" not in left and "command" not in left
    assert left["sensors"]["drive"] != listed["drive"], "its zero and latency were found"


@pytest.mark.few(1)
@pytest.mark.parametrize("seed", seeds(6, 3))
def test_the_estimator_is_right_by_the_file_that_is_written(seed: int, tmp_path: Path) -> None:
    """Within 0.1 µm, beside the noise that the same readings leave with a file that is exactly true.

    What goes against the rotor once a turn may come of azimuths that are off, as far as the file says they are unsure.
    """
    built = build(seed, count=4 + seed % 2, even=False, swap=seed % 2 == 1, known_tilt=True, duration=DURATION)
    bag, nominal = written(built, tmp_path)
    assert run(bag, nominal, tmp_path / "stage.yaml") == 0
    check_errors(built, stage_of(built.true), bag, load_stage(tmp_path / "stage.yaml"))


@pytest.mark.long
@pytest.mark.parametrize("number", seeds(2))
def test_an_azimuth_that_is_found_beyond_a_turn_is_written_within(number: int, tmp_path: Path) -> None:
    drawn = (build(seed, count=3, even=False, swap=False, duration=DURATION) for seed in range(1, 200))
    last = "c"
    beyond = (each for each in drawn if each.true["encoder"]["heads"][last]["azimuth"] > 2 * np.pi + 0.005)
    built = next(each for k, each in enumerate(beyond) if k == number)
    bag, nominal = written(built, tmp_path)
    assert run(bag, nominal, tmp_path / "stage.yaml", "--force") in (0, 10)  # three heads need not tell their layout
    found = load_stage(tmp_path / "stage.yaml").azimuths[last]
    off = found - built.true["encoder"]["heads"][last]["azimuth"]
    assert abs(off - 2 * np.pi * np.rint(off / (2 * np.pi))) < np.radians(4.0)


def test_what_it_says_and_writes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    built = build(4, count=5, even=False, swap=True, known_tilt=True, duration=DURATION)
    bag, nominal = written(built, tmp_path)
    text = "# what the data sheets say\n" + nominal.read_text(encoding="utf-8").replace(
        "    disc_radius:", "    # RESM\n    disc_radius:"
    )
    nominal.write_text(text, encoding="utf-8")
    output = tmp_path / "stage.yaml"
    assert run(bag, nominal, output) == 0
    said = capsys.readouterr().out
    first, second = built.swapped
    assert f"heads {first} and {second} are swapped (put right in the stage file)" in said
    for letter, head in built.true["encoder"]["heads"].items():
        assert (f"head {letter} counts the other way" in said) == (head["sign"] == -1)
    assert "what this recording cannot tell:" in said and "a zero common to all angles" in said
    assert "# what the data sheets say" in output.read_text(encoding="utf-8")
    assert "    # RESM" in output.read_text(encoding="utf-8")
    stage = load_stage(output)
    for letter, head in built.true["encoder"]["heads"].items():
        off = stage.azimuths[letter] - head["azimuth"]
        assert abs(off - 2 * np.pi * np.rint(off / (2 * np.pi))) < np.radians(4.0)
        assert stage.response(f"head_{letter}").gain == head["sign"]
        assert stage.response(f"head_{letter}").latency >= 0
    notes = yaml.safe_load(output.read_text(encoding="utf-8"))["stage"]["calibration"]
    assert notes["encoder"]["date"] == "2026-11-27" and len(notes["mirror"]["sha256"]) == 64
    assert notes["encoder"]["history"][0]["values"][f"encoder.heads.{first}.zero"] is None
    assert "encoder.eccentricity" not in stage.uncertainty, "in place nobody tells it from the rotor's own motion"


@pytest.mark.few(1)
@pytest.mark.parametrize("seed", [21, 22, 23])
def test_noise_that_is_said_to_be_put_right_is_in_the_file(
    seed: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    louder = 8.0
    built = build(seed, count=5, even=False, known_tilt=True, duration=DURATION, noise=louder)
    bag, nominal = written(built, tmp_path)
    assert run(bag, nominal, tmp_path / "stage.yaml") == 0
    said = capsys.readouterr().out
    described, found = load_stage(nominal), load_stage(tmp_path / "stage.yaml")
    assert "autocollimator is noisier than described" in said and "head a is noisier than described" in said
    # the world's noise is of 0.7 to 1.3 times the size, and in part slower than what shows
    assert 0.45 < found.tilt_instrument.noise / (louder * described.tilt_instrument.noise) < 1.4
    assert 0.45 < found.ring.noise / (louder * described.ring.noise) < 1.4
    assert run(bag, tmp_path / "stage.yaml", tmp_path / "again.yaml") == 0
    assert "noisier" not in capsys.readouterr().out


def test_what_no_file_puts_right_is_written_by_force_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    built = build(5, count=4, even=False, swap=False, known_tilt=True, duration=DURATION)
    degrees = in_unit(built.recording, [COMMAND], 180 / np.pi)
    bag, nominal = written(built, tmp_path, mirrored(degrees, "y"))
    output = tmp_path / "stage.yaml"
    assert run(bag, nominal, output) == 10
    said = capsys.readouterr().out
    assert "command is in degrees" in said and "set its driver to rad" in said
    assert "the autocollimator's y is reversed" in said
    assert not output.exists()
    assert run(bag, nominal, output, "--force") == 10
    notes = yaml.safe_load(output.read_text(encoding="utf-8"))["stage"]["calibration"]
    assert "command is in degrees" in notes["encoder"]["remark"]
    assert "zero" not in yaml.safe_load(output.read_text(encoding="utf-8"))["stage"]["autocollimator"]


def cut(recording: Recording, topics: dict[str, slice]) -> Recording:
    return recording.with_topics(
        {topic: (recording.blocks[topic][part], recording.arrivals[topic][part]) for topic, part in topics.items()}
    )


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"motion": "standstill"}, "stands still"),
        ({"motion": "oscillation", "peak_speed": 0.2}, "° only; record a whole turn"),
        ({"motion": "steady"}, "one direction alone does not tell a delay from a zero"),
    ],
)
def test_motion_that_does_not_tell_is_refused(
    options: dict[str, object], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, nominal = written(build(1, count=4, duration=15.0, **options), tmp_path)
    assert run(bag, nominal, tmp_path / "stage.yaml") == 2
    error = capsys.readouterr().err
    assert said in error and str(bag) in error
    assert not (tmp_path / "stage.yaml").exists()


def test_streams_that_are_not_there_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    built = build(2, count=4, even=False, swap=False, duration=DURATION)
    for name, topics in {"head": [head_topic("b")], "all": list(built.recording.blocks)}.items():
        folder = tmp_path / name
        folder.mkdir()
        left = {topic: [] if topic in topics else blocks for topic, blocks in built.recording.blocks.items()}
        bag, nominal = written(built, folder, Recording(built.true, left, {}, built.recording.truth, 0, 0.0))
        assert run(bag, nominal, folder / "stage.yaml") == 2
        assert "no message on /stage/head_" in capsys.readouterr().err
    built.nominal["lvdt"] = {"height": 0.016, "noise": 5e-8}
    bag, nominal = written(built, tmp_path)
    assert run(bag, nominal, tmp_path / "stage.yaml") == 10
    assert "LVDT: no samples" in capsys.readouterr().out


def test_a_head_that_comes_and_goes_or_stands_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    built = build(6, count=4, even=False, swap=False, duration=DURATION)
    topic = head_topic("c")
    for folder in (tmp_path / "goes", tmp_path / "stuck"):
        folder.mkdir()
    count = len(built.recording.blocks[topic])
    keep = [k for k in range(count) if (8 * k // count) % 2 == 0]
    gone = {topic: ([built.recording.blocks[topic][k] for k in keep], built.recording.arrivals[topic][keep])}
    bag, nominal = written(built, tmp_path / "goes", built.recording.with_topics(gone))
    assert run(bag, nominal, tmp_path / "goes" / "stage.yaml") in (2, 10)
    printed = capsys.readouterr()
    assert "head c lost" in printed.out or "in common" in printed.err
    bag, nominal = written(built, tmp_path / "stuck", in_unit(built.recording, [topic], 0.0))
    assert run(bag, nominal, tmp_path / "stuck" / "stage.yaml") == 2
    assert "head_c: does not follow the rotation" in capsys.readouterr().err


@pytest.mark.few(1)
@pytest.mark.parametrize("seed", seeds(3))
@pytest.mark.parametrize("unit", [1.0, 180 / np.pi])
def test_heads_that_jump_make_no_file(
    seed: int, unit: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As where samples were lost on a path that takes a large step for a turn."""
    rng = np.random.default_rng(seed)
    built = build(60 + seed, count=4, even=False, swap=False, duration=DURATION)
    recording = in_unit(built.recording, [*built.recording.head_topics, COMMAND], unit)
    changed = {}
    for topic in recording.head_topics:
        jumps = np.sort(rng.uniform(0.2, 0.8, 3)) * len(recording.blocks[topic])
        blocks = [
            SampleBlock(each.stamp_ns, each.names, each.rows + [0.0, 2 * np.pi * np.count_nonzero(k > jumps)])
            for k, each in enumerate(recording.blocks[topic])
        ]
        changed[topic] = blocks, recording.arrivals[topic]
    bag, nominal = written(built, tmp_path, recording.with_topics(changed))
    assert run(bag, nominal, tmp_path / "stage.yaml") in (2, 10)
    printed = capsys.readouterr()
    assert "jump against the others" in printed.out or printed.err
    assert not (tmp_path / "stage.yaml").exists()


def test_heads_at_one_azimuth_are_refused_with_their_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    built = build(8, count=3, duration=20.0)
    heads = built.nominal["encoder"]["heads"]
    built.nominal["encoder"]["disc_radius"] = 1.0  # there such heads have room
    heads["b"]["azimuth"] = heads["a"]["azimuth"] + 0.01
    bag, nominal = written(built, tmp_path)
    assert run(bag, nominal, tmp_path / "stage.yaml") == 2
    error = capsys.readouterr().err
    line = 1 + nominal.read_text(encoding="utf-8").split("\n").index("    heads:")
    assert f"nominal.yaml:{line}: stage.encoder.heads: a and b stand 0.57° apart" in error


def test_a_stage_without_heads_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    built = build(9, count=3, duration=20.0)
    bag, nominal = written(built, tmp_path)
    del built.nominal["encoder"]
    nominal.write_text(yaml.safe_dump({"stage": built.nominal}), encoding="utf-8")
    assert run(bag, nominal, tmp_path / "stage.yaml") == 2
    assert "no section 'encoder'" in capsys.readouterr().err


def test_a_gain_of_the_command_is_not_commissioned(tmp_path: Path) -> None:
    stage = yaml.safe_load(config("stage.yaml").read_text(encoding="utf-8"))["stage"]
    path = tmp_path / "list.yaml"
    path.write_text(yaml.safe_dump({"stage": {**stage, "sensors": {"drive": {"kind": "command", "gain": 2.0}}}}))
    told = r"list\.yaml:\d+: stage\.sensors\.drive\.gain: a gain of the command, which commissioning does not"
    with pytest.raises(InputError, match=told):
        commission_stage(tmp_path / "no_bag", path)
