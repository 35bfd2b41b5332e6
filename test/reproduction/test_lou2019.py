"""The procedure of Lou et al. 2019 carried out once: through the commands, against the truth of the simulation."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from rotary_error_monitor.cli import main
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.reproduction.lou2019_plant import LouStage
from rotary_error_monitor.reproduction.units import ARCSEC

SEED = 4

FIGURES = (
    "Figure 5",
    "Figure 7",
    "Figure 8",
    "Figure 9",
    *(f"Figure {n} ({p})" for n in (10, 11, 13, 14) for p in "ab"),
)


@pytest.fixture(scope="module")
def carried_out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the results."""
    folder = tmp_path_factory.mktemp("reproduction") / "lou2019"
    assert main(["reproduce", "lou2019", "-o", str(folder), "--seed", str(SEED)]) == 0
    return folder


def test_ring_mirror_and_autocollimator_are_found(carried_out):
    """Off by no more than four times what centres and reference leave: 0.3 µm, 0.3 arcsec and 0.2 arcsec."""
    true, found, known = LouStage(SEED).true, load_stage(carried_out / "stage.yaml"), LouStage(SEED).known
    assert known.ring.eccentricity == known.mirror.tilt == (0.0, 0.0) and not known.ring.graduation
    assert np.abs(np.subtract(found.ring.eccentricity, true.ring.eccentricity)).max() < 1.2e-6
    assert np.abs(np.subtract(found.mirror.tilt, true.mirror.tilt)).max() < 1.2 * ARCSEC
    graduation = {row.order: (row.cos, row.sin) for row in true.ring.graduation}
    for row in found.ring.graduation:
        assert np.abs(np.subtract((row.cos, row.sin), graduation.pop(row.order))).max() < 2e-8
    assert not graduation
    tilts = np.stack(np.meshgrid(*(np.linspace(-80, 80, 9) * ARCSEC,) * 2), axis=-1).reshape(-1, 2)
    response = true.response("autocollimator")
    read = np.array(response.zero) + tilts + np.array(response.cubic) * tilts**3
    assert np.abs(found.response("autocollimator").corrected(read) - tilts).max() < 0.8 * ARCSEC


def test_the_page_has_each_figure_and_each_command(carried_out):
    page = (carried_out / "page.html").read_text(encoding="utf-8")
    for figure in FIGURES:
        assert f"alt='{figure}" in page, figure
    assert page.count("alt='Figure 15") == 2
    assert len(re.findall(r"<pre>\$ rotary_error_monitor (calibrate|replay|compare)", page)) == 7
    assert "Simulated: " in page and "no value" in page
    assert "✗" not in page.partition("<h2>1. ")[0]


def test_results_are_never_written_over(carried_out, capsys):
    before = sorted(path.stat().st_mtime_ns for path in carried_out.iterdir())
    assert main(["reproduce", "lou2019", "-o", str(carried_out)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert sorted(path.stat().st_mtime_ns for path in carried_out.iterdir()) == before


def test_a_seed_below_zero_is_refused(tmp_path, capsys):
    assert main(["reproduce", "lou2019", "-o", str(tmp_path / "new"), "--seed", "-1"]) == 2
    assert "--seed is -1" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()
