"""The page of faults is what the tests say."""

from faults.documenting import GROUPS, PAGE, collected
from faults.page import page


def test_the_page_is_what_the_tests_show():
    assert PAGE.read_text(encoding="utf-8") == page(), "doc/faults.md is not what the tests say; run make faults-doc"


def test_every_chapter_has_faults_and_every_fault_a_whole_row():
    rows = collected()
    assert {row.group for row in rows} == set(GROUPS)
    assert all(all(vars(row).values()) for row in rows)
    assert len({(row.group, row.fault) for row in rows}) == len(rows)
