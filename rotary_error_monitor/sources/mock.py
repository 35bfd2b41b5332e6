"""The mock stage: each process evaluates the same seeded plant as a function of time, so all see the same rotor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import OWN_REFERENCE
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plant.clocks import stage_clocks
from rotary_error_monitor.plant.environment import FORCE_CYCLE, Forces, intermittent_forces
from rotary_error_monitor.plant.motion import reversing_motion
from rotary_error_monitor.plant.stage import StagePlant
from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock, block_from_samples
from rotary_error_monitor.sources.device import Device, Instrument
from rotary_error_monitor.sources.source import Source

MOCK = "mock"
MOCK_SETTINGS = (
    Setting("mock.seed", 1, "seed of the mock stage, the same in every process of a cell", (0, 2**31 - 1)),
    Setting(
        "mock.epoch",
        0,
        "instant at which the mock stage starts, ns since 1970, the same in every process; "
        "0 for the last midnight (UTC)",
        (0, 2**62),
    ),
    Setting("mock.speeds", [1.5707963267948966, 6.283185307179586], "speeds of a cycle of the mock stage, rad/s"),
    Setting("mock.forces", True, "whether something pushes at the mock stage's shaft now and then"),
    Setting(
        "mock.force_cycle",
        FORCE_CYCLE,
        "time after which the pushes at the mock stage repeat, s",
        (7.0, 3600.0),
    ),
)
"""What the processes of a mock cell agree on, as parameters of each."""

RATE = Setting("rate", 0.0, "samples a second of the mock source; 0.0 for the instrument's usual rate", (0.0, 1e6))
HEIGHT = Setting(
    "mock.height", 0.0, "height of the mock artefact above the ring, m; 0.0 for that of the stage", (-10.0, 10.0)
)

_DAY = 86_400 * NANOSECONDS
_AHEAD = NANOSECONDS // 10


@dataclass(frozen=True)
class MockSettings:
    """What the processes of a mock cell agree on.

    Attributes:
        seed: of all that is random.
        epoch_ns: when the stage starts, timestamp (ns).
        speeds: speeds of a cycle of the stage, rad/s.
        forces: whether something pushes at the shaft now and then.
        rate: samples a second of heads, autocollimator and listed sensors; None for their usual rates.
        force_cycle: after which the pushes repeat, s.
    """

    seed: int
    epoch_ns: int
    speeds: Sequence[float]
    forces: bool = True
    rate: float | None = None
    force_cycle: float = FORCE_CYCLE


def last_midnight(now_ns: int) -> int:
    """Timestamp (ns) of the last midnight (UTC): an epoch on which processes agree without a word."""
    return now_ns - now_ns % _DAY


def mock_stage(stage: StageDescription, settings: MockSettings) -> StagePlant:
    """The true stage of a mock cell."""
    return StagePlant(
        stage,
        seed=settings.seed,
        epoch_ns=settings.epoch_ns,
        motion=reversing_motion(settings.speeds),
        forces=intermittent_forces(settings.seed, settings.force_cycle) if settings.forces else Forces(),
        clocks=stage_clocks(tuple(stage.azimuths), settings.rate, tuple(stage.sensors), stage.inputs),
    )


def mock_settings(setting: Callable[[str], Any], now_ns: int, rate: float | None = None) -> MockSettings:
    """What the parameters of a process say about the mock stage.

    Args:
        setting: value of a parameter by its name.
        now_ns: timestamp (ns).
        rate: samples a second of heads, autocollimator and listed sensors; None or 0 for their usual rates.
    """
    return MockSettings(
        seed=setting("mock.seed"),
        epoch_ns=setting("mock.epoch") or last_midnight(now_ns),
        speeds=tuple(setting("mock.speeds")),
        forces=setting("mock.forces"),
        force_cycle=setting("mock.force_cycle"),
        rate=rate or None,
    )


class MockDevice(Device):
    """Base of all that show the true stage of a mock cell."""

    name = MOCK
    meaning = "simulated samples, for a mock cell"
    simulated = True


class MockInstrument(MockDevice):
    """What an instrument of the true stage shows that all mock sources of the cell see."""

    serves = ("encoder_head", "autocollimator", "listed_sensor")
    settings = (*MOCK_SETTINGS, RATE)

    def open(self, instrument: Instrument) -> MockSource:
        """The instrument's stream of the stage.

        Raises:
            InputError: the stage has no such instrument.
        """
        settings = mock_settings(instrument.setting, instrument.now_ns, instrument.setting(RATE.name))
        return _stream_of(mock_stage(instrument.stage, settings), instrument)


class MockSurroundings(MockDevice):
    """What drives the true stage: its command, the force on its shaft, its temperature."""

    serves = ("stage_command", "stage_force", "stage_temperature")
    settings = MOCK_SETTINGS

    def open(self, instrument: Instrument) -> MockSource:
        """The instrument's stream of the stage."""
        return _stream_of(
            mock_stage(instrument.stage, mock_settings(instrument.setting, instrument.now_ns)), instrument
        )


class MockReference(MockDevice):
    """The reference of the true stage, at a height of the user's choice."""

    serves = (OWN_REFERENCE,)
    settings = (*MOCK_SETTINGS, HEIGHT)

    def open(self, instrument: Instrument) -> MockSource:
        """The reference's stream of the stage.

        Raises:
            InputError: the stage has no reference of its own.
        """
        stage, height = instrument.stage, instrument.setting(HEIGHT.name)
        if stage.reference is not None and height:
            stage = stage.with_reference(replace(stage.reference, height=height))
        return _stream_of(mock_stage(stage, mock_settings(instrument.setting, instrument.now_ns)), instrument)


def _stream_of(plant: StagePlant, instrument: Instrument) -> MockSource:
    if instrument.stream not in plant.streams:
        where = instrument.setting("stage") or "stage.yaml"
        raise InputError(f"{where}: the stage has no section '{instrument.stream}'")
    return MockSource(plant, instrument.stream)


class MockSource(Source):
    """Samples of one stream of the mock stage.

    The plant knows the future as well as the past, so blocks are made ahead of their need: many at once cost hardly
    more than one, and what is left to do on time is little.
    """

    def __init__(self, plant: StagePlant, stream: str) -> None:
        """Samples of `stream`, such as `head_a`, `autocollimator`, `command`, `force`, `temperature`."""
        self._plant = plant
        self._stream = stream
        self._ahead: dict[tuple[int, int], SampleBlock | None] = {}

    def take(self, since_ns: int, until_ns: int) -> SampleBlock | None:
        """Block of the samples from `since_ns` to before `until_ns`."""
        if (since_ns, until_ns) not in self._ahead:
            self._look_ahead(since_ns, until_ns - since_ns)
        return self._ahead.pop((since_ns, until_ns))

    def _look_ahead(self, since_ns: int, duration_ns: int) -> None:
        """Blocks of equal duration from `since_ns` on."""
        edges = since_ns + duration_ns * np.arange(max(_AHEAD // duration_ns, 1) + 1)
        first, last = (self._plant.index_at(self._stream, int(edge)) for edge in edges[[0, -1]])
        # One sample more, so that there is one even in a span shorter than the distance of two.
        samples = self._plant.samples(self._stream, first, last - first + 1)
        places = np.searchsorted(samples.times_ns, edges).tolist()
        self._ahead = {
            (begin, end): _part(samples, i, k)
            for (begin, end), (i, k) in zip(pairwise(edges.tolist()), pairwise(places), strict=True)
        }


def _part(samples: SampleBlock, first: int, last: int) -> SampleBlock | None:
    if first == last:
        return None
    return block_from_samples(samples.times_ns[first:last], samples.names[1:], samples.rows[first:last, 1:])
