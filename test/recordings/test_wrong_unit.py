"""A recording whose autocollimator tells another unit: a replay says that its samples were not used."""

from __future__ import annotations

from recordings.test_sparse_streams import recorded, samples_of

from rotary_error_monitor.cli import main
from rotary_error_monitor.signals.blocks import SampleBlock


def test_samples_beyond_the_end_of_a_range_are_told(tmp_path, capsys):
    """In mrad for rad they left no word but that of a stage without tilt."""
    blocks = samples_of(5, {})
    blocks["autocollimator"] = [
        SampleBlock(block.stamp_ns, block.names, block.rows * [1.0, 1e3, 1e3]) for block in blocks["autocollimator"]
    ]
    bag = recorded(tmp_path / "bag", blocks)
    assert main(["replay", str(bag), "-o", str(tmp_path / "out.npz")]) == 0
    told = capsys.readouterr().err
    assert "autocollimator: " in told
    assert "samples at or beyond the end of its range were not used; is its unit right?" in told
