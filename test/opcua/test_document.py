"""doc/opcua.md says what the code does."""

from __future__ import annotations

import re
from pathlib import Path

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.opcua.board import Quality
from rotary_error_monitor.opcua.model import (
    NAMESPACE,
    CellDescription,
    health_variables,
    information_model,
)
from rotary_error_monitor.opcua.server import MOST_STATUSES
from rotary_error_monitor.pipeline.observability import possible_components

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "doc" / "opcua.md").read_text(encoding="utf-8")
FIGURES = ("rate_hz", "age_ms", "lost_samples", "late_blocks", "refused_messages")


def markdown_table(variables):
    """The variables as a Markdown table, a row a variable."""
    rows = ["| node id `ns=…;s=` | unit (code) | what | of | level of | stale after |", "|---|---|---|---|---|---|"]
    for variable in variables:
        kinds = {str: "text", bool: "truth value", float: f"{variable.unit.symbol} ({variable.unit.code})"}
        source = f"`{variable.status}`" if variable.status else f"topic `{variable.source}`"
        judge = f"`{variable.judge}`" if variable.judge else ""
        cells = (f"`{variable.path}`", kinds[variable.type], variable.meaning, source, judge)
        rows.append("| " + " | ".join((*cells, f"{variable.stale_after:g} s")) + " |")
    return "\n".join(rows) + "\n"


def test_the_table_is_that_of_the_code():
    stage, machine = load_stage(), load_machine("xyzac_trt")
    cell = CellDescription(stage.limits, possible_components(stage), machine, lambda node, what: f"{node}: {what}")
    expected = markdown_table([*information_model(cell), *health_variables("<status>", FIGURES)])
    (shown,) = re.findall(r"<!-- table: .* -->\n(.*?)<!-- end -->", TEXT, re.DOTALL)
    assert shown == expected, f"put this into doc/opcua.md:\n{expected}"


def test_every_status_code_is_explained():
    assert set(re.findall(r"^\| `(\w+)` \| ", TEXT, re.MULTILINE)) - {"address"} == {each.value for each in Quality}


def test_names_and_numbers_are_those_of_the_code():
    assert TEXT.count(NAMESPACE) == 2
    assert f"At most {MOST_STATUSES} statuses" in TEXT
