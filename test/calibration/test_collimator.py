"""`calibrate autocollimator`: from a file of steps to the stage file, and what is told of files that do not do."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from calibration.simulated_collimator import (
    ARCSEC,
    Detector,
    Run,
    cross,
    quadrant_voltages,
    shown_by,
    table,
    take,
    write_table,
)

from rotary_error_monitor.calibration.stage_document import kept_figures
from rotary_error_monitor.calibration.yaml_document import YamlDocument
from rotary_error_monitor.cli import main
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.metrology.tilt import tilt_from_quadrants
from rotary_error_monitor.metrology.two_axis_fit import NAMES, numbers_of
from rotary_error_monitor.resources import config

SURE = ["--reference-arcsec", "0.115"]
ROLLED = Detector((4 * ARCSEC, -2 * ARCSEC), (1.03, 0.99), (0.2, 0.21), (-1e5, 4e4))


@pytest.fixture
def stage(tmp_path: Path) -> Path:
    path = tmp_path / "stage.yaml"
    shutil.copy(config("stage.yaml"), path)
    return path


def calibrate(source: Path, stage: Path, *options: str) -> int:
    return main(["calibrate", "autocollimator", str(source), "--stage", str(stage), *SURE, *options])


def taken(folder: Path, detector: Detector = ROLLED, run: Run | None = None, seed: int = 1, **how: object) -> Path:
    rng = np.random.default_rng([seed, 77])
    return write_table(folder / "steps.csv", table(take(detector, run or Run(), rng), **how))


def test_the_stage_file_holds_the_instrument_and_all_else_stays(tmp_path, stage, capsys):
    before = stage.read_text(encoding="utf-8").splitlines()
    assert calibrate(taken(tmp_path), stage, "--date", "2026-11-26", "--figure", str(tmp_path / "found.png")) == 0
    said = capsys.readouterr().out
    assert "220 readings in 44 steps at 21 settings, 44 steps used" in said and f"written to {stage}" in said
    assert (tmp_path / "found.png").stat().st_size > 30_000
    found = load_stage(stage)
    stds = [found.uncertainty[f"autocollimator.{name.partition('[')[0]}"] for name in NAMES]
    truth = [ROLLED.truth[name] for name in NAMES]
    off = (numbers_of(found.response("autocollimator")) - truth) / stds
    assert (np.abs(off) < 3.5).all(), "eight of them"
    after = stage.read_text(encoding="utf-8").splitlines()
    assert [line for line in after if line in before] == before
    note = yaml.safe_load(stage.read_text(encoding="utf-8"))["stage"]["calibration"]["autocollimator"]
    assert note["date"] == "2026-11-26" and note["source"] == "steps.csv" and "remark" not in note
    assert 0 < note["figures"]["residual_x"] < 0.5 * ARCSEC and note["uncertainty"] < 0.2 * ARCSEC
    assert found.autocollimator == load_stage().autocollimator


def test_a_second_calibration_keeps_the_first_and_does_not_contradict_it(tmp_path, stage):
    assert calibrate(taken(tmp_path), stage) == 0
    first = load_stage(stage).response("autocollimator")
    assert calibrate(taken(tmp_path, seed=2), stage) == 0
    note = yaml.safe_load(stage.read_text(encoding="utf-8"))["stage"]["calibration"]["autocollimator"]
    assert note["history"][0]["values"]["autocollimator.cubic"] == list(first.cubic)
    assert len(note["history"]) == 2


def test_an_instrument_that_was_adjusted_is_told_and_forced_with_an_uncertainty_that_covers_it(tmp_path, stage, capsys):
    assert calibrate(taken(tmp_path), stage) == 0
    text, old = stage.read_text(encoding="utf-8"), load_stage(stage).response("autocollimator").gain
    adjusted = taken(tmp_path, Detector((4 * ARCSEC, -2 * ARCSEC), (1.06, 1.02), (0.2, 0.21), (-1e5, 4e4)))
    capsys.readouterr()
    assert calibrate(adjusted, stage) == 10
    assert stage.read_text(encoding="utf-8") == text
    assert re.search(r"autocollimator\.gain was 1\.0.* and now is 1\.0.*: was it adjusted", capsys.readouterr().out)
    assert calibrate(adjusted, stage, "--force") == 0
    forced = load_stage(stage)
    assert forced.uncertainty["autocollimator.gain"] >= forced.response("autocollimator").gain - old > 0.02
    note = yaml.safe_load(stage.read_text(encoding="utf-8"))["stage"]["calibration"]["autocollimator"]
    assert "was it adjusted" in note["remark"]


def test_the_same_steps_in_microradian_say_the_same(tmp_path, stage):
    assert calibrate(taken(tmp_path), stage) == 0
    arcsec = numbers_of(load_stage(stage).response("autocollimator"))
    other = tmp_path / "urad.yaml"
    shutil.copy(config("stage.yaml"), other)
    assert calibrate(taken(tmp_path, unit="urad"), other) == 0
    np.testing.assert_allclose(numbers_of(load_stage(other).response("autocollimator")), arcsec, rtol=2e-3)


def test_what_is_kept_stays_and_a_statement_of_the_file_follows(tmp_path, stage, capsys):
    content = yaml.safe_load(stage.read_text(encoding="utf-8"))
    content["stage"]["autocollimator"] |= {"zero": [1e-5, 2e-5], "roll": 0.7, "gain": -1.0}
    content["stage"]["uncertainty"] |= {"autocollimator.gain": 0.05, "autocollimator.roll": 0.01}
    content["stage"]["calibration"] = {
        "autocollimator": {
            "date": "2026-01-01",
            "source": "bag",
            "sha256": 64 * "a",
            "figures": {"zero_uncertainty": 1e-6, "latency_uncertainty": 2e-4, "gain_uncertainty": 0.02},
        }
    }
    stage.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    # the file counts the other way: its roll is half a turn from that of a positive gain
    assert calibrate(taken(tmp_path), stage, "--keep", "zero", "roll") == 0
    found = load_stage(stage)
    response = found.response("autocollimator")
    assert response.zero == (1e-5, 2e-5) and response.roll == 0.7
    assert response.gain == pytest.approx(-ROLLED.truth["gain"], rel=5e-3)
    assert 0 < found.uncertainty["autocollimator.gain"] < 0.005
    assert found.uncertainty["autocollimator.zero"] == 1e-6 and found.uncertainty["autocollimator.roll"] == 0.01
    assert "the cubic terms hold: readings at the end of the range are off by up to" not in capsys.readouterr().out
    document = YamlDocument(stage, "stage")
    assert dict(kept_figures(document, ("latency",))) == {"latency_uncertainty": 2e-4}


def test_a_zero_that_is_kept_far_from_that_of_the_steps_is_told(tmp_path, stage, capsys):
    """3 cubic d e^2 with d 30 and e 100 arcsec: of a bend by 2.4 % at 100, 2.1 arcsec."""
    bend = (-0.024 / (100 * ARCSEC) ** 2, 0.0)
    assert calibrate(taken(tmp_path, Detector((30 * ARCSEC, 0.0), bend=bend)), stage, "--keep", "zero") == 0
    off = re.search(r"up to (3\d\.\d|29\.\d) arcsec .* off by up to ([\d.]+) arcsec", capsys.readouterr().out)
    assert off and float(off[2]) == pytest.approx(2.16, rel=0.2)


def test_readings_without_noise_and_a_reference_that_is_hardly_off_are_solved(tmp_path, stage):
    source = taken(tmp_path, ROLLED, Run(repeats=1, noise=0.0, reference=0.0))
    assert calibrate(source, stage, "--reference-arcsec", "1000", "--force") == 0
    assert calibrate(source, stage, "--reference-arcsec", "0.0001", "--force") == 0
    found = numbers_of(load_stage(stage).response("autocollimator"))
    np.testing.assert_allclose(found[2:6], [ROLLED.truth[name] for name in NAMES[2:6]], atol=1e-4)


def test_a_stage_that_lists_its_autocollimator_among_its_sensors(tmp_path, stage):
    content = yaml.safe_load(stage.read_text(encoding="utf-8"))
    section = content["stage"].pop("autocollimator")
    content["stage"]["sensors"] = {"mirror": {"kind": "autocollimator", **section}}
    stage.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    assert calibrate(taken(tmp_path), stage) == 0
    assert load_stage(stage).response("autocollimator").gain == pytest.approx(ROLLED.truth["gain"], rel=5e-3)
    written = yaml.safe_load(stage.read_text(encoding="utf-8"))["stage"]
    assert "autocollimator" not in written and "cubic" in written["sensors"]["mirror"]


def quadrants(folder: Path, seed: int, run: Run, **how: float) -> Path:
    rng = np.random.default_rng([seed, 78])
    steps, voltages = quadrant_voltages(run, rng, **how)
    return write_table(folder / "steps.csv", table(steps, voltages=voltages))


@pytest.mark.parametrize("seed", range(4))
def test_voltages_of_the_node_become_true_tilts(tmp_path, stage, seed):
    """Read as source iio reads them and corrected as the stage file says; the spot is no cubic term, but nearly."""
    run = Run(repeats=8)
    how = {"radius": 500 * ARCSEC, "oval": 1.04, "dark": 0.05}
    node = ["--sensitivity", "0.0015", "--dark", "0.05", "0.05", "0.05", "0.05"]
    assert calibrate(quadrants(tmp_path, seed, run, **how), stage, *node, "--force") == 0
    rng = np.random.default_rng([seed, 79])
    still = Run(settings=cross(np.arange(-95.0, 96.0, 10.0)), repeats=1, noise=0.0, reference=0.0)
    _, voltages = quadrant_voltages(still, rng, **how)
    read = tilt_from_quadrants(voltages, 0.0015, np.full(4, 0.05))
    tilts = shown_by(still, rng)[0]
    off = load_stage(stage).response("autocollimator").corrected(read) - tilts
    assert np.abs(off).max() < 0.4 * ARCSEC < 2 * ARCSEC < np.abs(read - tilts).max()


def test_figure_5_of_lou_2019(tmp_path, stage, capsys):
    """Residuals within ±0.5 and ±0.8 arcsec over ±100, by a reference of an accuracy of ±0.2 and steps of 0.1."""
    within = []
    for seed in range(12):
        shutil.copy(config("stage.yaml"), stage)
        run = Run(reference=0.2 / np.sqrt(3) * ARCSEC, noise=0.1 * ARCSEC, repeats=3)
        assert calibrate(quadrants(tmp_path, seed, run, oval=1.05), stage, "--sensitivity", "0.0015") in (0, 10)
        said = capsys.readouterr().out
        x, y, *explained = map(float, re.findall(r"±([\d.]+)", re.search(r"residual.*", said)[0]))
        within.append(x <= 0.5 and y <= 0.8)
        assert explained[0] < 0.5 and min(explained[2:]) > 2.0, "without a calibration far more is left"
    assert np.mean(within) > 0.9


def test_steps_beyond_the_range_make_it_what_is_usable(tmp_path, stage, capsys):
    detector, wide = Detector(end=88 * ARCSEC), Run(settings=cross(np.arange(-120.0, 121.0, 20.0)))
    assert calibrate(taken(tmp_path, detector, wide), stage) == 0
    assert load_stage(stage).autocollimator.range == pytest.approx(80 * ARCSEC, rel=0.01)
    assert re.search(r"range ±(79|80)\.\d arcsec, before ±100\.0", said := capsys.readouterr().out)
    assert "beyond the usable range, left out: step s1, s2, s12" in said
    shutil.copy(config("stage.yaml"), stage)
    assert calibrate(taken(tmp_path, Detector(), wide), stage) == 0
    assert load_stage(stage).autocollimator.range == pytest.approx(120 * ARCSEC, rel=0.01)
    shutil.copy(config("stage.yaml"), stage)
    assert calibrate(taken(tmp_path, Detector(), Run(settings=cross(np.arange(-50.0, 51.0, 10.0)))), stage) == 0
    assert load_stage(stage).autocollimator == load_stage().autocollimator
    assert re.search(r"note: steps reach (49\.|50\.)\d arcsec of the range of ±100\.0", capsys.readouterr().out)


@pytest.mark.parametrize(
    ("run", "told"),
    [
        (Run(lost=1.5 * ARCSEC), r"reference x comes to the same angle 1\.[45]\d+ arcsec apart from its two sides"),
        (Run(moved={7: 3 * ARCSEC}), r"steps that do not fit the others: s8 \([+-][23]\."),
        (Run(reference=0.6 * ARCSEC), r"what is left is \d\.\d+ times what reference and noise explain"),
    ],
)
def test_what_does_not_fit_is_written_by_force_only(tmp_path, stage, capsys, run, told):
    before = stage.read_text(encoding="utf-8")
    source = taken(tmp_path, Detector(), run)
    assert calibrate(source, stage) == 10
    assert re.search(told, capsys.readouterr().out) and stage.read_text(encoding="utf-8") == before
    assert calibrate(source, stage, "--force") == 0
    found = load_stage(stage)
    stds = [found.uncertainty[f"autocollimator.{name.partition('[')[0]}"] for name in NAMES]
    off = (numbers_of(found.response("autocollimator")) - [Detector().truth[name] for name in NAMES]) / stds
    assert (np.abs(off) < 3.5).all()


def test_steps_that_stand_off_are_dropped_where_that_is_asked_for(tmp_path, stage, capsys):
    assert calibrate(taken(tmp_path, Detector(), Run(moved={7: 3 * ARCSEC})), stage, "--drop-outliers") == 0
    assert "note: left out of the fit: step s8" in capsys.readouterr().out


def test_units_that_cannot_be_are_doubted(tmp_path, stage, capsys):
    text = taken(tmp_path).read_text(encoding="utf-8")
    (tmp_path / "mixed.csv").write_text(text.replace("tilt_x_arcsec,tilt_y_arcsec", "tilt_x_urad,tilt_y_urad"))
    assert calibrate(tmp_path / "mixed.csv", stage) == 10
    assert "the gain is 0.20" in (said := capsys.readouterr().out) and "in the units of the header?" in said


HEAD = "step,reference_x_arcsec,reference_y_arcsec,tilt_x_arcsec,tilt_y_arcsec"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            f"{HEAD}\na,0,0,0.1,0\nb,10,0,9.8,0\na,0,0,0.1,0",
            r"4: step 'a' comes again, first on line 2; expected a name",
        ),
        (f"{HEAD}\na,0,0,0.1,0\na,10,0,9.8,0", r"3: step 'a' has another reference than on the line before"),
        (
            f"{HEAD}\na,0,0,0.1,0\nb,30000,0,9.8,0",
            r"3: reference_x_arcsec 30000 is beyond ±20626.5: is it in another unit",
        ),
        (f"{HEAD}\na,0,0,0.1,0\nb,10;0,0,1,1", r"3: reference_x_arcsec '10;0' is no number"),
        (f"{HEAD}\na,0,0,0.1,0\nb,10,0,9.8,0", r"2 different settings; expected 5 or more"),
        (HEAD.replace("arcsec", "arcmin") + "\na,0,0,0,0", r"1: header .*; expected reference_x_UNIT,.* UNIT one of"),
        (HEAD.replace("x_arcsec", "x_urad") + "\na,0,0,0,0", r"1: header .*; expected reference_x_UNIT"),
        (HEAD + ",time_s\na,0,0,0,0,5\na,0,0,0,0,4", r"3: time 4 s after 5 s; expected rows in order of time"),
        (
            "reference_x_urad,reference_y_urad,q1_V,q2_V,q3_V,q4_V\n0,0,1,1,1,1\n10,0,0,0,0,0",
            r"3: voltages \[0.0, 0.0, 0.0, 0.0\] V hold no light above the dark",
        ),
        (
            HEAD + "".join(f"\n{n},{n % 3},{n // 3},1,{n // 3}" for n in range(9)),
            r"the readings follow the reference by 1 along one direction and \d.* across; expected 0\.001 or more",
        ),
        ("", r"1: the file is empty"),
    ],
)
def test_bad_input_is_told_with_its_line(tmp_path, stage, capsys, text, told):
    path = write_table(tmp_path / "steps.csv", text)
    before = stage.read_text(encoding="utf-8")
    assert calibrate(path, stage) == 2
    said = capsys.readouterr().err
    assert (
        re.search(rf"steps\.csv:? ?{told}", said.replace(" (UNIT", " UNIT"))
        and stage.read_text(encoding="utf-8") == before
    )


def test_one_axis_alone_too_many_steps_and_a_stage_without_an_autocollimator_are_refused(tmp_path, stage, capsys):
    along = np.stack([np.arange(-50.0, 51.0, 10), np.zeros(11)], axis=1)
    assert calibrate(taken(tmp_path, run=Run(settings=along)), stage) == 2
    assert "steps.csv: only one axis moved: reference x spans" in capsys.readouterr().err
    many = Run(settings=np.arange(1002.0).reshape(-1, 2) / 10, repeats=1)
    assert calibrate(taken(tmp_path, run=many), stage) == 2
    assert "501 steps; expected 500 at most" in capsys.readouterr().err
    content = yaml.safe_load(stage.read_text(encoding="utf-8"))
    del content["stage"]["autocollimator"], content["stage"]["mirror"]
    stage.write_text(yaml.safe_dump(content), encoding="utf-8")
    assert calibrate(taken(tmp_path), stage) == 2
    assert "stage.yaml: the stage has no section 'autocollimator', which this calibrates" in capsys.readouterr().err
