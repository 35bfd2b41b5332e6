"""A reproduction says what it does, and stops where a command fails."""

from __future__ import annotations

import pytest

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.reproduction.page import page, text_table
from rotary_error_monitor.reproduction.procedure import Bench, PaperComparison, ProcedureStep, Reproduction

ROWS = (
    PaperComparison("speed", "1 r/s", "1.00 r/s", "rounded", True),
    PaperComparison("eccentricity", "no value", "24 µm", "a curve is shown"),
)


def of(*rows: PaperComparison) -> Reproduction:
    return Reproduction("lou2019", "Lou et al.", "a stage", (ProcedureStep("Measure", "Section 3"),), rows)


def test_a_command_that_fails_is_told_with_what_it_said(tmp_path):
    said: list[str] = []
    bench = Bench(tmp_path, said.append)
    with pytest.raises(InputError, match=r"replay nowhere.*exit code 2, expected 0: .*nowhere"):
        bench.run("replay", "nowhere", "-o", "out.npz")
    assert said == ["$ rotary_error_monitor replay nowhere -o out.npz"]


def test_commands_run_in_the_folder(tmp_path):
    typed, said = Bench(tmp_path).run("wire")
    assert typed == "rotary_error_monitor wire" and said.startswith("| topic")


@pytest.mark.parametrize(("holds", "kept"), [(True, True), (None, True), (False, False)])
def test_one_statement_that_does_not_hold_is_enough(holds, kept):
    found = of(*ROWS, PaperComparison("residual", "less than 2 µm", "3 µm", "noise", holds))
    assert found.kept is kept
    text = page(found)
    assert ("✓ Reproduced" in text) is kept and ("✗ Not reproduced" in text) is not kept
    assert f"{1 + (holds is True)} of {1 + (holds is not None)} statements" in text


def test_the_table_names_paper_and_result():
    lines = text_table(ROWS).splitlines()
    assert [line.split()[0] for line in lines] == ["quantity", "speed", "eccentricity"]
    assert lines[1].endswith("✓ yes") and lines[2].endswith("—")
