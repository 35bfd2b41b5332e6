"""The feedback of a controller: how often, and at what rate corrections change."""

from types import SimpleNamespace

import pytest

from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.nodes.applied_corrections import AppliedCorrections

MS = 1_000_000
NOW = 1_800_000_000_000_000_000


@pytest.fixture
def sent():
    return []


@pytest.fixture
def applied(sent):
    publisher = SimpleNamespace(publish=sent.append)
    return AppliedCorrections(SimpleNamespace(wire=load_wire(()), publish_on=lambda topic: publisher))


def test_twenty_a_second_go_out_with_the_rate_since_the_last(applied, sent):
    for index in range(251):
        applied.publish(NOW + index * 4 * MS, "XA", (index * 4e-9, -index * 8e-9))
    assert len(sent) in (20, 21)
    assert list(sent[0].velocity) == [0.0, 0.0]
    for each in sent[1:]:
        assert list(each.velocity) == pytest.approx([1e-6, -2e-6])
        assert list(each.effort) == [0.0, 0.0]
        assert each.header.frame_id == "base"


@pytest.mark.parametrize("later_ns", [-(10**13), -60 * MS, 700 * MS, 10**13])
def test_over_a_pause_or_a_clock_that_was_set_no_rate_is_told(applied, sent, later_ns):
    applied.publish(NOW, "XA", (0.0, 0.0))
    applied.publish(NOW + later_ns, "XA", (1e-6, 0.0))
    applied.publish(NOW + later_ns + 50 * MS, "XA", (2e-6, 0.0))
    assert [list(each.velocity) for each in sent] == [[0.0, 0.0], [0.0, 0.0], pytest.approx([2e-5, 0.0])]


def test_another_machine_begins_anew(applied, sent):
    applied.publish(NOW, "XA", (0.0, 0.0))
    applied.publish(NOW + 100 * MS, "XYZ", (1e-6, 0.0, 0.0))
    assert list(sent[1].velocity) == [0.0] * 3
