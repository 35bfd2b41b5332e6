"""Effects of the LVDT and the artefact that it touches."""

from __future__ import annotations

from dataclasses import replace

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import OWN_REFERENCE
from rotary_error_monitor.effects.effect import Parameter, Values
from rotary_error_monitor.effects.rotor import ComponentGain, StageEffect


class LvdtGain(ComponentGain):
    """One component of the LVDT reads too large or too small."""

    name = "lvdt_gain"
    title = "LVDT's scale"
    remedy = "Calibrate the LVDT against gauge blocks or a micrometer and state its gain."
    source = "calibration of an LVDT's scale factor"
    acts_on = (OWN_REFERENCE,)


class LvdtArtefact(StageEffect):
    """The artefact is mounted elsewhere on the rotor than the twin says."""

    name = "lvdt_artefact"
    title = "artefact mounted off centre"
    remedy = "Centre the artefact, or state lvdt.artefact_eccentricity."
    source = "ISO 230-7, Annex (artefact eccentricity)"
    parameters = (Parameter("shift", "m", 1e-6, 2, bound=1e-3),)
    acts_on = (OWN_REFERENCE,)

    def amend(self, stage: StageDescription, values: Values, location: str) -> StageDescription:
        """Add the shift to the artefact's eccentricity."""
        if stage.reference is None:
            return stage
        x, y = stage.reference.artefact_eccentricity
        shifted = (x + float(values[0]), y + float(values[1]))
        return stage.with_reference(replace(stage.reference, artefact_eccentricity=shifted))


class LvdtHeight(StageEffect):
    """The LVDT touches at another height than the twin says."""

    name = "lvdt_height"
    title = "LVDT at another height"
    remedy = "Measure the height of the LVDT above the ring and state it."
    source = "Lou et al. 2019, Equation 7 (radial error motion at a height)"
    parameters = (Parameter("offset", "m", 1e-3, bound=1.0),)
    rescales = True
    acts_on = (OWN_REFERENCE,)

    def amend(self, stage: StageDescription, values: Values, location: str) -> StageDescription:
        """Add to the height."""
        if stage.reference is None:
            return stage
        return stage.with_reference(replace(stage.reference, height=stage.reference.height + float(values[0])))
