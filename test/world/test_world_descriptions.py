"""Wrong descriptions: each is valid, and differs from the true one only where it says."""

from __future__ import annotations

from copy import deepcopy

import numpy as np
import pytest

from rotary_error_monitor.description.sections import from_content
from rotary_error_monitor.description.stage_section import StageSection

from .descriptions import DESCRIPTIONS
from .stages import random_stage
from .test_world_stage import DEFAULT


@pytest.mark.parametrize("name", DESCRIPTIONS)
def test_a_wrong_description_is_valid_and_wrong_only_where_it_says(name):
    for true in (DEFAULT, random_stage(0), random_stage(1)):
        kept = deepcopy(true)
        wrong = DESCRIPTIONS[name](true, np.random.default_rng(1))
        assert true == kept
        from_content(StageSection, wrong, "stage")
        if true is DEFAULT:
            assert wrong != true
        for key in DESCRIPTIONS[name].keys:
            section, _, entry = key.partition(".")
            for stage in (true := deepcopy(true), wrong):
                if entry:
                    stage.get(section, {}).pop(entry, None)
                else:
                    stage.pop(section, None)
        assert wrong == true


def test_the_draw_is_reproducible():
    for description in DESCRIPTIONS.values():
        first, second = (description(DEFAULT, np.random.default_rng(4)) for _ in range(2))
        assert first == second
