"""Effects of the displacement probes that a stage lists by name, and of the targets that they look at."""

from __future__ import annotations

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.effects.effect import Parameter, wave_of_order
from rotary_error_monitor.effects.listed import ListedDrift, ListedGain, ListedWave, ListedZero, streams_of


class ProbeZero(ListedZero):
    """A probe stands nearer to its target, or further away, than the twin says."""

    name = "probe_zero"
    title = "zero of a probe"
    remedy = "Set the probe's zero, or state it."
    source = "setting of a displacement probe's zero (ISO 230-7, Annex A)"
    parameters = (Parameter("shift", "m", 1e-6, bound=1e-2),)
    listed_unit = "m"
    listed_fields = 1


class ProbeGain(ListedGain):
    """A probe reads displacements too large or too small; its zero stays."""

    name = "probe_gain"
    title = "scale of a probe"
    remedy = "Calibrate the probe against a micrometer and state its gain."
    source = "calibration of a displacement probe's sensitivity"
    parameters = (Parameter("relative", "1", 1e-2, bound=2.0),)
    listed_unit = "m"
    listed_fields = 1


class ProbeDrift(ListedDrift):
    """A probe's zero moves steadily."""

    name = "probe_drift"
    title = "drift of a probe"
    remedy = "Let probe and amplifier warm up; look for a holder that creeps."
    source = "warming-up of a probe, its amplifier and its holder, lowest order in time"
    parameters = (Parameter("rate", "m/s", 1e-8, bound=1e-5),)
    listed_unit = "m"
    listed_fields = 1


class ProbeForm(ListedWave):
    """What probes look at shows one more order over a turn. Order 1: it is off centre, or a face askew."""

    name = "probe_form"
    title = "form error of a probe's target, of one order"
    remedy = "State the target's form (or its centring) with the sensor or target, or use a rounder target."
    source = "ISO 230-7, Annex (roundness and centring of the artefact); ISO 1101 (roundness, axial run-out)"
    parameters = wave_of_order("m", 1e-6, bound=1e-3)
    listed_unit = "m"
    listed_fields = 1

    def locations(self, machine: StageDescription) -> tuple[str, ...]:
        """Each probe or target but those on the axis: they look at one and the same spot all the time."""
        first = {each: machine.sensors[streams_of(each)[0]] for each in super().locations(machine)}
        return tuple(each for each, sensor in first.items() if sensor.place.get("radius") != 0.0)
