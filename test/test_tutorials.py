"""The tutorials on real measurements: each command is run, and what it says is what the page says."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest

from rotary_error_monitor.cli import main

ROOT = Path(__file__).parents[1]
REAL = ROOT.parent / "shared" / "real"
FOLDERS = {"tutorial_mount": "telescope_two_axis_pointing", "tutorial_quadrature": "nmm_quadrature"}
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e-?\d+)?")

pytestmark = pytest.mark.skipif(not REAL.is_dir(), reason="no real measurements beside the checkout (../shared/real)")


def page(name):
    return (ROOT / "doc" / f"{name}.md").read_text(encoding="utf-8")


def examples(name):
    """Commands of a page with what it says that they print."""
    return re.findall(r"```sh\n(.*?)\n```\n```text\n(.*?)\n```", page(name), re.DOTALL)


ALL = [(name, command, output) for name in FOLDERS for command, output in examples(name)]


def table(name):
    """Rows of the page's table by the name in their first cell, numbers only."""
    rows = re.findall(r"^\| `(\w+)` \| (.*) \|$", page(name), re.MULTILINE)
    return {key: [float(cell) for cell in cells.split(" | ")] for key, cells in rows}


def same(said, shown):
    """Equal words, and numbers that agree to the rounding that another computer may make differently."""
    assert NUMBER.split(said) == NUMBER.split(shown)
    for one, other in zip(NUMBER.findall(said), NUMBER.findall(shown), strict=True):
        assert float(one) == pytest.approx(float(other), rel=0.05, abs=1e-9), (said, shown)


@pytest.fixture(scope="module")
def diagnoses():
    return {}


@pytest.mark.parametrize(("name", "command", "output"), ALL, ids=[shlex.split(c)[-1] for _, c, _ in ALL])
def test_a_command_finds_what_the_page_says(name, command, output, diagnoses, tmp_path, monkeypatch, capsys):
    words = shlex.split(command)
    assert words[:2] == ["rotary_error_monitor", "diagnose"]
    (file,) = (REAL / FOLDERS[name]).glob(f"{words[2]}*")
    place = words.index("-o") + 1
    folder = tmp_path / words[place]
    monkeypatch.chdir(ROOT)
    code = main(["diagnose", str(file), *words[3:place], str(folder)])
    assert str(code) in re.findall(r"exit code is (\d+) each time", page(name))
    same(" ".join(output.split()), " ".join(capsys.readouterr().out.split()))
    assert {path.name for path in folder.iterdir()} == {"diagnosis.json", "diagnosis.html", "diagnosis.png"}
    diagnoses[words[place]] = json.loads((folder / "diagnosis.json").read_text())


def diagnosis_of(key, diagnoses):
    if key not in diagnoses:
        pytest.skip("its command was not run in this session")
    return diagnoses[key]


@pytest.mark.parametrize("key", sorted(table("tutorial_mount")))
def test_the_table_of_mounts_holds_the_figures(key, diagnoses):
    figures = diagnosis_of(key, diagnoses)["figures"]
    names = ("held_out_indices", "held_out_geometry", "held_out_causes", "noise")
    expected = [figures[f"{name}_arcsec"] for name in names]
    assert table("tutorial_mount")[key][1:] == pytest.approx(expected, rel=0.02, abs=0.6)


@pytest.mark.parametrize("key", sorted(table("tutorial_quadrature")))
def test_the_table_of_signals_holds_the_figures_and_the_authors(key, diagnoses):
    import numpy as np

    from rotary_error_monitor.kinds.quadrature.signals import read_signals

    figures = diagnosis_of(key, diagnoses)["figures"]
    folder = REAL / FOLDERS["tutorial_quadrature"]
    author = [
        float(np.std(np.abs(read_signals(folder / f"test01_XYZ_f_quad_{key}_{kind}.csv.gz"))))
        for kind in ("raw", "Heydemann", "MatusDai")
    ]
    names = ("radius_std_after_counts", "noise_counts", "position_error_largest_nm")
    expected = [*author, *(figures[name] for name in names)]
    assert table("tutorial_quadrature")[key] == pytest.approx(expected, rel=0.01, abs=0.006)


def said(name, pattern):
    """The number in a sentence of a page."""
    (found,) = re.findall(pattern, " ".join(page(name).split()))
    return float(found)


def probability(diagnosis, effect):
    return max(row["probability"] for row in diagnosis["ranking"] if row["effect"] == effect)


def test_numbers_in_the_text_about_mounts_are_those_found(diagnoses):
    gem, cgx, warp = (diagnosis_of(key, diagnoses) for key in ("gem_28", "cgx_l", "warp_astron"))
    arcsec = 206264.8
    name = "tutorial_mount"
    sag = gem["causes"][0]["parameters"]["sag"]["value"] * arcsec
    assert said(name, r"the sag is (\d+)″") == pytest.approx(sag, rel=0.01)
    assert gem["ranking"][1]["effect"] == "refraction_scale"
    assert gem["ranking"][1]["probability"] < said(name, r"probability is below (1e-\d+)")
    shares = r"`axis_eccentricity` has (\d+)%", r"`declination_axis_flexure` (\d+)%\. Out of"
    for pattern, effect in zip(shares, ("axis_eccentricity", "declination_axis_flexure"), strict=True):
        assert said(name, pattern) == pytest.approx(100 * probability(cgx, effect), abs=3)
    assert any("direction" in row["pattern"] for row in cgx["remainder"] if row["channel"] == "declination")
    rate = warp["causes"][0]["parameters"]["rate"]["value"] * arcsec * 3600
    assert said(name, r"moves by (\d+)″ an hour") == pytest.approx(rate, rel=0.01)
    assert said(name, r"at H with (\d+)%") == pytest.approx(100 * probability(warp, "axis_eccentricity"), abs=3)
    (group,) = warp["indistinguishable"]
    assert {row["effect"] for row in group["effects"]} == {"axis_eccentricity", "declination_axis_flexure"}
    assert group["advice"].startswith("no pointings")


def test_the_pages_show_pictures_that_are_small():
    for name in FOLDERS:
        assert f"({name}.png)" in page(name)
        assert (ROOT / "doc" / f"{name}.png").stat().st_size < 150_000
