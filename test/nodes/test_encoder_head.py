"""The read head node: mock, third-party driver, hardware counter."""

from __future__ import annotations

from rotary_error_monitor.nodes.encoder_head import EncoderHead
from rotary_error_monitor.testing import Cell


def test_mock_first() -> None:
    with Cell(parameters={"stage": "/work/shared/cases/open/open_001/twin.yaml"}) as cell:
        blocks = cell.collect(cell.wire.topic("head_samples", "a"))
        others = cell.collect(cell.wire.topic("head_samples", "b"))
        cell.run(EncoderHead, "encoder_head_a", rate=50000.0)
        cell.start("encoder_head", "encoder_head_b")
        cell.wait_until(lambda: len(blocks) > 300 and len(others) > 300, "blocks of both")
        s = cell.status("encoder_head_a: state")
        assert s.message == "active"
        print(cell._report())
