"""Twins on other courses of temperature predict what a twin that was made with that temperature predicts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotary_error_monitor.effects.effect import Cause, Parameter
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.kinds.stage.warming import uncertain_warmings
from rotary_error_monitor.twin.recording import StageRecording
from rotary_error_monitor.twin.stage import StageTwin, twin_of

KNOWN = {effect.name: effect for effect in load_effects(StageEffect)}


class WarmCoupling(StageEffect):
    """The coupling turns the rotor as it warms: what turns it differs from one course of temperature to the next."""

    name = "warm_coupling"
    parameters = (Parameter("twist", "rad/K", 1e-6),)

    def rotation(self, values, state):
        return values[0] * state.warming


CAUSES = {
    "nothing": (),
    "late and driven unevenly": (
        Cause(KNOWN["encoder_latency"], "", np.array([2e-4])),
        Cause(KNOWN["drive_cyclic_error"], "order_7", np.array([7.0, 3e-6, -2e-6])),
    ),
    "turned by warmth": (Cause(WarmCoupling(), "", np.array([5e-6])),),
}


@pytest.mark.parametrize("causes", CAUSES.values(), ids=CAUSES)
@pytest.mark.parametrize("measured", [True, False], ids=["thermometer", "no thermometer"])
def test_a_warmed_twin_is_a_twin_at_that_temperature(stage_problem, causes, measured):
    problem, _ = stage_problem(3, "null", duration=12.0)
    thermal = replace(problem.stage, spindle=replace(problem.stage.spindle, radial_thermal=(2e-7, -1e-7)))
    recording = problem.recording
    if not measured:
        streams = {name: stream for name, stream in recording.streams.items() if name != "temperature"}
        recording = StageRecording(recording.start_ns, streams)
    twin = twin_of(thermal, recording)
    warmed = uncertain_warmings(twin, recording)
    assert len(warmed) == (10 if measured else 4)  # its zero, what noise leaves open, and how late it is
    for other in warmed:
        direct = StageTwin(twin.stage, other.inputs, twin.times, twin.observed).predict(causes)
        for name, values in other.predict(causes).items():
            np.testing.assert_allclose(values, direct[name], rtol=0, atol=1e-13)
        cold = twin.predict(causes)
        assert max(float(np.ptp(direct[name] - cold[name])) for name in direct) > 1e-12


@pytest.mark.parametrize(("stated", "zero"), [({}, 0.4 / np.sqrt(3)), ({"environment.thermometer": 0.05}, 0.05)])
def test_the_zero_of_the_thermometer_is_as_uncertain_as_stated_or_as_its_class_allows(stage_problem, stated, zero):
    """Class B of IEC 60751 at 20 °C: 0.3 K and 0.005 of the temperature."""
    problem, _ = stage_problem(3, "null", duration=12.0)
    stage = replace(problem.stage, uncertainty={**problem.stage.uncertainty, **stated})
    first, *_ = uncertain_warmings(twin_of(stage, problem.recording), problem.recording)
    time = np.linspace(0.0, 12.0, 7)
    warmer = first.inputs.warming(time) - problem.twin.inputs.warming(time)
    np.testing.assert_allclose(warmer, zero, rtol=0.03)  # it is no longer at 20 °C
