"""`doc/faults.md`, made of the rows that stand at the tests; `make faults-doc` writes it anew."""

from __future__ import annotations

from faults.documenting import GROUPS, PAGE, Row, collected

_INTRODUCTION = """\
# Faults and what becomes of them

This page is made from the tests: each row stands at the test that shows it (`make faults-doc` writes the page, and a
test holds it against them). "Held" means that axis corrections stay where they are; while the axes move on, a held
correction can be off by as much as the error motion differs between the two places; `compensation: correction`
says how far the description would move the tool from there. After `hold_limit` (2 s) they go at the rate limit to what
the machine's description alone gives, and where joint states are not believed they stay.
What is refused is counted by its reason; all reasons stand in `/diagnostics` within a second. A second after the end of
a fault all is published again, from other instruments where one is not believed yet. It takes longer, or a reset,
where the data do not tell that the fault has ended: without redundancy, where heads were silent meanwhile; where a head
was off before a stage ever turned so fast that its stamps outweigh its noise; and where a fault was believed for more
than half of the last 10 s, so that its end looks like its begin. `/diagnostics` then goes on to name what is doubted.

What one instrument alone shows may be its own: the tilt, and what heads show without redundancy, or once one of them
was wrong. What of it is not as in the first turn, at the same angle, is three standard deviations for as long as it is
so. A tilt that the rotor makes as it yields to a push, by as much as the ring shows it to yield, counts for less than
half of that. A reset takes the next turn for the first one.
"""


def page() -> str:
    """The whole page."""
    rows = collected()
    chapters = [_chapter(title, [row for row in rows if row.group == group]) for group, title in GROUPS.items()]
    return "\n".join([_INTRODUCTION, *chapters])


def _chapter(title: str, rows: list[Row]) -> str:
    lines = [f"## {title}", "", "| fault | how it is seen | what is done | what is published | recovery | shown by |"]
    lines.append("|---|---|---|---|---|---|")
    for row in rows:
        cells = (row.fault, row.seen, row.done, row.published, row.recovery, f"[test](../{row.test.split('::')[0]})")
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
