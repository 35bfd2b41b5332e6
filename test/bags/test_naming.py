"""Bags that hold several cells, or call topics by names of their own: what a reader takes for which topic."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bags.conftest import assert_same

from rotary_error_monitor.bags.naming import read_naming
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.signals.blocks import SampleBlock

HEAD = "/stage/head_a/samples"


def within(namespace, contents):
    return {namespace + topic: rows for topic, rows in contents.items()}


def moved(contents):
    """The same topics with other samples, as of another cell."""
    return {
        topic: [
            SampleBlock(each.stamp_ns, each.names, each.rows + 1.0) if isinstance(each, SampleBlock) else each
            for each in rows
        ]
        for topic, rows in contents.items()
    }


@pytest.fixture
def two(tmp_path, contents):
    path = tmp_path / "two"
    write_messages(path, within("/left", contents) | within("/hall/right", moved(contents)))
    return path


def test_each_cell_reads_as_a_bag_of_its_own(two, contents):
    for cell, expected in (("/left", contents), ("left", contents), ("/hall/right", moved(contents))):
        reader = BagReader(two, read_naming(cell, None))
        found = reader.read()
        assert found.keys() == contents.keys() == reader.topics.keys()
        assert {message.topic for message in reader.messages([HEAD])} == {HEAD}
        for topic, rows in expected.items():
            assert len(found[topic]) == len(rows) == reader.topics[topic].count
            for one, other in zip(found[topic], rows, strict=True):
                assert_same(one, other)
        replayed = [content for topic, content in reader.replay([HEAD]) if topic == HEAD]
        assert len(replayed) == len(expected[HEAD])


def test_several_cells_are_named_where_none_is_meant(two):
    with pytest.raises(InputError, match=r"two: the bag holds 2 cells: /hall/right, /left; name one with --cell"):
        BagReader(two)
    with pytest.raises(InputError, match=r"two: no cell /up; the bag has /hall/right, /left"):
        BagReader(two, read_naming("/up", None))
    reader = BagReader(two, read_naming("/left", None))
    with pytest.raises(InputError, match=r"no message on /stage/head_q/samples in cell /left"):
        reader.check_topics(["/stage/head_q/samples"])


def test_the_only_cell_needs_no_name(tmp_path, contents):
    write_messages(tmp_path / "one", within("/left", contents))
    assert BagReader(tmp_path / "one").read().keys() == contents.keys()


def test_a_cell_without_a_namespace_is_one_beside_others(tmp_path, contents):
    write_messages(tmp_path / "bag", contents | within("/left", moved(contents)))
    with pytest.raises(InputError, match="holds 2 cells: /, /left"):
        BagReader(tmp_path / "bag")
    (first, *_) = BagReader(tmp_path / "bag", read_naming("/", None)).read([HEAD])[HEAD]
    assert_same(first, contents[HEAD][0])


def test_topics_that_never_spoke_and_those_of_nobody_make_no_cell(tmp_path, contents):
    """`ros2 bag record -a` records whatever there is: a listener's topic, a driver's, the clock."""
    extra = {"/left" + HEAD: [], "/right/encoder": contents[HEAD], "/left/stage/odd": contents[HEAD]}
    reader_topics = contents | {name: rows for name, rows in extra.items() if rows}
    write_messages(tmp_path / "bag", reader_topics)
    assert BagReader(tmp_path / "bag").topics.keys() == reader_topics.keys()


def test_topics_of_other_names_are_those_that_a_file_says(tmp_path, contents):
    foreign = {"/enc/one": contents[HEAD], "/ac": contents["/stage/autocollimator/samples"]}
    write_messages(tmp_path / "bag", foreign)
    names = tmp_path / "names.yaml"
    names.write_text(f"# of the old recorder\n{HEAD}: /enc/one\n/stage/autocollimator/samples: /ac\n")
    reader = BagReader(tmp_path / "bag", read_naming(None, names))
    for topic in (HEAD, "/stage/autocollimator/samples"):
        for one, other in zip(reader.read([topic])[topic], contents[topic], strict=True):
            assert_same(one, other)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "/stage/head_a/sample: /enc",
            r"names.yaml:1: '/stage/head_a/sample' is no topic of the wire contract; did you",
        ),
        (f"# a\n{HEAD}: /encoder", r"names.yaml:2: no topic '/encoder' in .*bag; the bag has /enc"),
        (f"{HEAD}: /enc\n/stage/lvdt/samples: /enc", r"names.yaml:2: '/enc' stands for two topics"),
        (
            f"{HEAD}: /warmth",
            r"names.yaml:1: '/warmth' is a sensor_msgs/msg/Temperature; .* sensor_msgs/msg/PointCloud2",
        ),
        (f"{HEAD}: [1]", r"names.yaml:1: /stage/head_a/samples: expected the name of a topic"),
        (f"{HEAD}: 3", r"names.yaml:1: /stage/head_a/samples: expected the name of a topic"),
        ("", r"names.yaml: names no topic; expected lines such as"),
        ("- /enc", r"names.yaml: names no topic; expected lines such as"),
        (f"{HEAD}: /enc\n{HEAD}: /warmth", r"names.yaml:2: key .* stands twice"),
    ],
)
def test_a_wrong_file_of_topics_is_refused_with_its_line(tmp_path, contents, text, said):
    write_messages(tmp_path / "bag", {"/enc": contents[HEAD], "/warmth": contents["/machine/temperature"]})
    names = tmp_path / "names.yaml"
    names.write_text(text)
    with pytest.raises(InputError, match=said):
        BagReader(tmp_path / "bag", read_naming(None, names))


def test_a_name_for_one_topic_of_a_cell_leaves_the_others(tmp_path, contents):
    moved_away = {"/enc": moved(contents)[HEAD]}
    write_messages(tmp_path / "bag", within("/left", contents) | within("/right", contents) | moved_away)
    names = Path(tmp_path / "names.yaml")
    names.write_text(f"{HEAD}: /enc\n")
    found = BagReader(tmp_path / "bag", read_naming("/left", names)).read()
    assert found.keys() == contents.keys()
    assert np.array_equal(found[HEAD][0].rows, contents[HEAD][0].rows + 1.0)
