"""Uncertain parameters: which streams each of them moves, against predictions."""

from __future__ import annotations

import numpy as np

from rotary_error_monitor.cases.making import make_stage_case
from rotary_error_monitor.description.topics import samples_topic
from rotary_error_monitor.twin.recording import record_stage
from rotary_error_monitor.twin.stage import twin_of
from rotary_error_monitor.twin.stage_parameters import uncertain_parameters


def test_a_parameter_moves_the_streams_that_it_names_and_no_other():
    case = next(
        c for c in (make_stage_case(seed, "null", rough=True, duration=10.0) for seed in range(9)) if c.twin.lvdt
    )
    topics = {samples_topic(stream): list(blocks) for stream, blocks in case.blocks.items()}
    twin = twin_of(case.twin, record_stage(topics, "abcd"))
    base = twin.predict()
    parameters = uncertain_parameters(case.twin)
    assert len(parameters) > 40
    for parameter in parameters:
        # A step of many uncertainties, so that the effect of a compliance stands far above rounding.
        moved = twin.predict(stage=parameter.shifted(case.twin, 100 * parameter.uncertainty))
        kinds = {name.partition("_")[0] for name in base if np.ptp(moved[name] - base[name]) > 1e-15}
        if "compliance" not in parameter.name or "force" in case.blocks:
            assert kinds == set(parameter.seen_by), parameter.name
