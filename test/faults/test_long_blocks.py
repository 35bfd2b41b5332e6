"""Blocks of one stream that are far longer than the instrument can have measured, or of other columns."""

from __future__ import annotations

import numpy as np
import pytest
from described_stages import stage_of
from world import Recording, random_stage

from faults.documenting import Row, shows
from faults.ending import SIGMAS, distance_of
from faults.judging import estimated, record
from faults.recordings import MOST_WRONG
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.signals.blocks import SampleBlock

NUMBER, DURATION, MILLION = 20, 3.0, 1_000_000
NAMES = {"a million points": ("t", "angle"), "other columns": ("t", "angular")}


def with_another(recording: Recording, topic: str, names: tuple[str, ...]) -> Recording:
    """A block of a million points in the hundredth of a second before the middle, as one that stands elsewhere says."""
    blocks, arrivals = recording.blocks[topic], recording.arrivals[topic]
    place = len(blocks) // 2
    rows = np.column_stack([np.linspace(-0.01, 0.0, MILLION), np.zeros(MILLION)])
    long = SampleBlock(blocks[place - 1].newest_ns + 3_000_000, names, rows)
    changed = [*blocks[:place], long, *blocks[place:]], np.insert(arrivals, place, arrivals[place - 1])
    return recording.with_topics({topic: changed})


def estimate(recording: Recording) -> tuple[Estimator, ErrorMotion]:
    estimator = Estimator(stage_of(random_stage(NUMBER)))
    return estimator, ErrorMotion.joined(estimated(recording, estimator, lambda _: None))


@shows(
    Row(
        "messages",
        "A block of a million points, or of other columns, comes on the stream of one head",
        "`refused …`: which columns are there, and which are needed; of the points `samples refused`, by their reason",
        "other columns are refused; of the points those that fit neither the stamps nor the speed of the axis",
        "everything, for a while from the other heads",
        "with the next block; after the million points within 1 s",
    )
)
@pytest.mark.parametrize("names", NAMES.values(), ids=NAMES)
def test_a_block_that_no_instrument_gives_changes_nothing(names):
    recording = record(NUMBER, random_stage(NUMBER), DURATION, block_period=0.02)
    topic = recording.head_topics[0]
    (_, sound), (estimator, found) = estimate(recording), estimate(with_another(recording, topic, names))
    stream = estimator.status.streams[topic.split("/")[2]]
    if names == NAMES["other columns"]:
        with pytest.raises(InputError, match="angular"):
            estimator.accept("head_a", SampleBlock(found.times_ns[-1], names, np.zeros((1, 2))))
        np.testing.assert_array_equal(found.components, sound.components)
        return
    assert stream.admission.refused.total() > 0.99 * MILLION
    off, deviation = distance_of(recording, found)
    assert (found.observable & ~(off <= SIGMAS * deviation)).mean(axis=0).max() <= MOST_WRONG
    assert found.observable.mean() > 0.9 * sound.observable.mean()
    assert len(found.times_ns) > 0.9 * len(sound.times_ns)
