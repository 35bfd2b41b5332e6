"""Faults put into recordings of many random stages: how often what is published is wrong.

make faults FAULT_FIRST=1 FAULT_SEEDS=20
prints a line for each fault, and fails where one is wrong more often than stated
"""

import os

import pytest
from world import FAULTS

from faults.behaviours import WRONG_DESCRIPTIONS
from faults.recordings import MOST_WRONG, case

FIRST = int(os.environ.get("FAULT_FIRST", "1"))
SEEDS = int(os.environ.get("FAULT_SEEDS", "20"))
DURATION = 20.0
"""Length of a recording, s."""


@pytest.mark.parametrize("name", [*FAULTS, *WRONG_DESCRIPTIONS])
def test_nothing_wrong_is_published(name, capsys):
    every = {number: case(name, number, DURATION) for number in range(FIRST, FIRST + SEEDS)}
    found = {number: each.found for number, each in every.items() if each is not None}
    wrong = {number: dict(each.wrong) for number, each in found.items() if each.worst > MOST_WRONG}
    with capsys.disabled():
        available = sum(sum(each.available.values()) / 5 for each in found.values()) / max(len(found), 1)
        print(f"{name}: {len(wrong)} of {len(found)} wrong, {available:.0%} of the components published")
    assert not wrong, wrong
