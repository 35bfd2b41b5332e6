"""Each kind of page made once, from short recordings, by the commands that users give."""

from __future__ import annotations

import itertools
import shutil
from pathlib import Path

import numpy as np
import pytest
from commissioning.bags import run, written
from mock_bags import write_day
from world.newly_built import build, in_unit
from world.recording import head_topic

from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.blind_check.cases import draw_machine, write_case
from rotary_error_monitor.cases.making import make_machine_case, make_stage_case
from rotary_error_monitor.cli import main
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.description.topics import samples_topic
from rotary_error_monitor.reproduction.lou2019 import PAPER, SIMULATED
from rotary_error_monitor.reproduction.lou2019_figures import Readings, original_errors
from rotary_error_monitor.reproduction.page import page
from rotary_error_monitor.reproduction.procedure import Bench, PaperComparison, ProcedureStep, Reproduction
from rotary_error_monitor.sources.mock import MockSettings, mock_stage

EPOCH_NS = 1_763_700_000_000_000_000
STREAMS = (*(f"head_{head}" for head in "abcd"), "autocollimator", "command", "lvdt", "temperature")

KINDS = (
    "analysis",
    "analysis_of_less_than_a_turn",
    "commissioning",
    "comparison",
    "diagnosis_of_a_stage",
    "diagnosis_of_a_machine",
    "diagnosis_of_a_folder",
    "reproduction",
    "trend",
)
"""Pages that the package writes, and those of recordings that tell little."""


def _recorded(folder: Path, seconds: float) -> str:
    """Bag of a mock stage."""
    plant = mock_stage(load_stage(), MockSettings(5, EPOCH_NS, (4.0,), forces=False, rate=300.0))
    contents = {}
    for stream in STREAMS:
        edges = [plant.index_at(stream, EPOCH_NS + k * 250_000_000) for k in range(int(4 * seconds) + 1)]
        contents[samples_topic(stream)] = [
            plant.samples(stream, first, last - first) for first, last in itertools.pairwise(edges) if last > first
        ]
    write_messages(folder / "bag", contents)
    return str(folder / "bag")


def _analysis(folder: Path, seconds: float) -> Path:
    limits = ["--limits", "radial_total_um=100", "tilt_total_nrad=5"] if seconds > 2 else []
    heights = ["--height", "0", "60"]
    arguments = ["analyse", _recorded(folder, seconds), *heights, *limits, "-o", str(folder / "page.html")]
    assert main(arguments) in (0, 10)
    return folder / "page.html"


def _comparison(folder: Path) -> Path:
    assert main(["compare", _recorded(folder, 8.0), "-o", str(folder / "page.html")]) in (0, 10)
    return folder / "page.html"


def _commissioning(folder: Path) -> Path:
    """Heads swapped, and one that reads degrees, which no file puts right."""
    built = build(11, count=4, even=False, swap=True, duration=24.0)
    degrees = in_unit(built.recording, [head_topic("b")], 180 / np.pi)
    bag, nominal = written(built, folder, degrees)
    assert run(bag, nominal, folder / "stage.yaml", "--page", str(folder / "page.html")) == 10
    return folder / "page.html"


def _diagnosis(folder: Path, kind: str) -> Path:
    if kind == "stage":
        made = make_stage_case(5, "single", ["mirror_wobble"], (150.0, 300.0), duration=20.0)
    else:
        made = make_machine_case(draw_machine(5), 5, "single", ["squareness"])
    write_case(made, folder / "case")
    twin = str(folder / "case" / "twin.yaml")
    assert main(["diagnose", str(folder / "case" / "bag"), "--twin", twin, "-o", str(folder / "out")]) == 10
    return folder / "out" / "diagnosis.html"


def _fleet(folder: Path) -> Path:
    """A machine with a cause, twice, and a bag that cannot be read."""
    write_case(make_machine_case(draw_machine(5), 5, "single", ["squareness"]), folder / "case")
    for name in ("north", "south"):
        shutil.copytree(folder / "case" / "bag", folder / "bags" / name / "bag")
    _write_broken(folder / "bags" / "broken")
    arguments = ["--twin", str(folder / "case" / "twin.yaml"), "--by-folder", "--jobs", "1"]
    assert main(["diagnose", str(folder / "bags"), *arguments, "-o", str(folder / "out")]) == 10
    return folder / "out" / "diagnosis.html"


def _trend(folder: Path) -> Path:
    """Days of a stage that leans more from the fourth on, beside limits, and a bag that cannot be read."""
    for day in range(6):
        write_day(folder / "bags" / f"day_{day}", day, 1.0e-5 if day < 3 else 1.4e-5)
    _write_broken(folder / "bags" / "broken")
    limits = ["--limits", "tilt_residual_synchronous_urad=22", "radial_total_um=100", "axial_total_um=1"]
    arguments = ["--height", "0", "--jobs", "1", *limits, "-o", str(folder / "page.html")]
    assert main(["trend", str(folder / "bags"), *arguments]) == 10
    return folder / "page.html"


def _reproduction(folder: Path) -> Path:
    """A command of the procedure, a figure of a recording, and rows that are kept, not kept, and without a value."""
    bag = Path(_recorded(folder, 8.0))
    typed, said = Bench(folder).run("calibrate", "--help")
    figures = original_errors(Readings(bag, load_stage()))
    rows = [
        PaperComparison(
            "resolution of the encoder (Section 3)", "0.412 arcsec", "0.4116 arcsec", "rounded in the paper", True
        ),
        PaperComparison(
            "largest residual from the LVDT at 5 mm", "less than 2 µm", "2.31 µm", "forces that nobody stated", False
        ),
        PaperComparison(
            "eccentricity of the grid disc (Figure 7)", "no value", "(23.7, -10.9) µm", "the paper shows a curve"
        ),
    ]
    step = ProcedureStep(
        "Measure ring and mirror", "Section 2.1", typed, said, figures, "The shaft is between centres."
    )
    found = Reproduction("lou2019", PAPER, SIMULATED, (step, ProcedureStep("Nothing", "Section 4")), tuple(rows))
    (folder / "page.html").write_text(page(found), encoding="utf-8")
    return folder / "page.html"


def _write_broken(folder: Path) -> None:
    folder.mkdir()
    (folder / f"{folder.name}_0.mcap").write_bytes(b"\x89MCAP0\r\n")


@pytest.fixture(scope="session")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """File of each of `KINDS`."""
    folders = {kind: tmp_path_factory.mktemp(kind) for kind in KINDS}
    return {
        "analysis": _analysis(folders["analysis"], 8.0),
        "analysis_of_less_than_a_turn": _analysis(folders["analysis_of_less_than_a_turn"], 1.25),
        "commissioning": _commissioning(folders["commissioning"]),
        "comparison": _comparison(folders["comparison"]),
        "diagnosis_of_a_stage": _diagnosis(folders["diagnosis_of_a_stage"], "stage"),
        "diagnosis_of_a_machine": _diagnosis(folders["diagnosis_of_a_machine"], "machine"),
        "diagnosis_of_a_folder": _fleet(folders["diagnosis_of_a_folder"]),
        "reproduction": _reproduction(folders["reproduction"]),
        "trend": _trend(folders["trend"]),
    }
