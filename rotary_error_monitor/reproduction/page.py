"""The page of a reproduction: a table of paper and result, then each step with its command and figures."""

from __future__ import annotations

import html

from rotary_error_monitor.report.page import (
    Tone,
    about,
    images,
    made_by,
    paragraph,
    section,
    table,
    verdict,
    whole_page,
)
from rotary_error_monitor.report.wording import aligned
from rotary_error_monitor.reproduction.procedure import PaperComparison, ProcedureStep, Reproduction

_KEPT = {True: "✓ yes", False: "✗ no", None: "—"}


def page(found: Reproduction) -> str:
    """The whole page."""
    stated = [row for row in found.rows if row.holds is not None]
    kept = sum(row.holds is True for row in stated)
    tone, badge = (Tone.GOOD, "✓ Reproduced") if found.kept else (Tone.BAD, "✗ Not reproduced")
    rows = [(row.quantity, row.paper, row.ours, row.why, _KEPT[row.holds]) for row in found.rows]
    told = f"{kept} of {len(stated)} statements of the paper that a simulation can keep hold in this one."
    return whole_page(
        "Reproduction",
        found.name,
        [
            verdict(tone, badge, told),
            paragraph(f"Simulated: {found.simulated}"),
            section("Paper and result", table(("quantity", "paper", "ours", "why they differ", "kept"), rows)),
            *(_step(number, step) for number, step in enumerate(found.steps, 1)),
            about({"paper": found.paper, "made by": made_by()}),
        ],
    )


def text_table(rows: tuple[PaperComparison, ...]) -> str:
    """Paper and result as lines for a terminal."""
    head = ("quantity", "paper", "ours", "kept")
    return "\n".join(aligned([head, *((row.quantity, row.paper, row.ours, _KEPT[row.holds]) for row in rows)]))


def _step(number: int, step: ProcedureStep) -> str:
    command = f"$ {step.command}\n" if step.command else ""
    said = f"<div class='wide' tabindex='0'><pre>{html.escape(command + step.said)}</pre></div>" if command else ""
    return section(
        f"{number}. {step.title}",
        paragraph(f"Paper: {step.source}."),
        paragraph(step.about) if step.about else "",
        said,
        images(step.figures),
    )
