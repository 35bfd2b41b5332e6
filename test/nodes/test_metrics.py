"""Metrics for Prometheus: what stands on /diagnostics, read by the library's own parser over HTTP."""

from __future__ import annotations

import socket
import sys
import urllib.error
import urllib.request

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from ports import free_port
from prometheus_client import CollectorRegistry, core, generate_latest
from prometheus_client.parser import text_string_to_metric_families

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes.encoder_head import EncoderHead
from rotary_error_monitor.nodes.metrics import Metrics, Statuses, number
from rotary_error_monitor.testing.cell import PATIENCE

LEVEL, FIGURE = "rotary_error_monitor_level", "rotary_error_monitor_figure"


def samples(text):
    """Values by metric and labels."""
    families = text_string_to_metric_families(text)
    return {(s.name, *sorted(s.labels.values())): s.value for family in families for s in family.samples}


def scraped(port):
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=PATIENCE) as answer:
        return samples(answer.read().decode())


def test_levels_and_figures_of_every_node_are_served(cell):
    port = free_port()
    node = cell.run(Metrics, "metrics", port=port)
    cell.run(EncoderHead, "encoder_head_a", source="mock")
    rate = (FIGURE, "encoder_head_a", "rate_hz", "stage.head_a.samples")
    values = {
        (LEVEL, "encoder_head_a", "mock", "state"): 0.0,
        (FIGURE, "encoder_head_a", "simulated", "state"): 1.0,
        (LEVEL, "metrics", "server", "stage"): 0.0,
    }

    def served():
        found = scraped(port)
        return found.get(rate, 0.0) > 100 and {key: found.get(key) for key in values} == values

    cell.wait_until(served, "what both nodes say")
    cell.remove(node)
    with pytest.raises(urllib.error.URLError):
        scraped(port)


def test_a_node_that_falls_silent_is_absent():
    now = [100.0]
    statuses = Statuses(core, lambda: now[0])
    registry = CollectorRegistry(auto_describe=False)
    registry.register(statuses)
    status = DiagnosticStatus(name='left.a: b "c"\n', level=b"\x02", values=[KeyValue(key="x_ms", value="nan")])
    statuses.note(DiagnosticArray(status=[status]))
    now[0] += 4.9
    assert samples(generate_latest(registry).decode())[LEVEL, "", 'b "c"\n', "left.a"] == 2.0
    now[0] += 0.2
    assert samples(generate_latest(registry).decode()) == {}


@pytest.mark.parametrize(
    ("text", "value"),
    [("1", 1.0), ("-2.5e-3", -0.0025), ("True", 1.0), ("false", 0.0), ("none", None), ("", None), ("a b", None)],
)
def test_what_is_a_number(text, value):
    assert number(text) == value


def test_a_port_that_is_taken_is_said(cell):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(InputError, match=rf"nothing can be served on 127\.0\.0\.1:{port} .*set port or address"):
            cell.run(Metrics, "metrics", port=port)


def test_without_the_library_it_is_said_how_to_install_it(cell, monkeypatch):
    monkeypatch.setitem(sys.modules, "prometheus_client", None)
    with pytest.raises(InputError, match=r"pip install 'rotary_error_monitor\[metrics\]'"):
        cell.run(Metrics, "metrics")
