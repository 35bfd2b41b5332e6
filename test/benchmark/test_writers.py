"""The ways of writing that are compared write the same messages, and bags that are made last as long as asked for."""

from __future__ import annotations

import pytest
from benchmark.long_bag import write_long_bag
from benchmark.writers import WAYS, messages_of, written
from rosbags.highlevel import AnyReader

from rotary_error_monitor.bags.reader import BagReader

RATE, SECONDS, TIMES = 1_000.0, 0.5, 2


@pytest.mark.parametrize("way", [way for way in WAYS if way != "bytes alone"])
def test_what_is_written_is_read_again(way, tmp_path):
    _, given = messages_of(RATE, SECONDS)
    told = written(way, tmp_path / "bag", RATE, SECONDS, TIMES)
    assert told["messages"] == TIMES * len(given) > 500
    files = sorted((tmp_path / "bag").glob("*.mcap"))
    with AnyReader([tmp_path / "bag"] if (tmp_path / "bag" / "metadata.yaml").exists() else files) as reader:
        found = sorted((time_ns, connection.topic, bytes(data)) for connection, time_ns, data in reader.messages())
    wanted = [
        (message.time_ns + turn * round(SECONDS * 1e9), message.topic, message.data)
        for turn in range(TIMES)
        for message in given
    ]
    assert found == sorted(wanted)


@pytest.mark.parametrize("seconds", [1.0, 3.0])
def test_a_bag_lasts_as_long_as_asked_for(seconds, tmp_path):
    told = write_long_bag(tmp_path / "bag", seconds=seconds, rate=200.0)
    times = [message.log_time_ns for message in BagReader(tmp_path / "bag").messages()]
    assert told == pytest.approx(seconds, abs=0.11)  # the blocks are of 0.1 s
    assert (max(times) - min(times)) * 1e-9 == pytest.approx(seconds, abs=0.3)
