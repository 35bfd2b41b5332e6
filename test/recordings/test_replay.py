"""Replay of recordings: the accuracy it must reach on independent data, what it writes, what it refuses."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
from kernels import computing_by, is_built
from mock_bags import write_mock_bag

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.cli import main
from rotary_error_monitor.description.stage import TIMINGS, load_stage
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.radial_comparison import compare_radial
from rotary_error_monitor.recordings.replay import replay_bag

PERIOD = 1_000_000


@pytest.mark.cases("open", "stage", "null")
def test_radial_error_motion_follows_the_lvdt(case):
    """Undisturbed stages made by another program: RMS at most 0.10 µm, maximum 0.5 µm (Lou et al. reach 2 µm)."""
    stage = load_stage(case / "twin.yaml")
    exact = ("encoder.eccentricity", "mirror.tilt", *TIMINGS)  # that program's own
    stage = replace(stage, uncertainty=dict.fromkeys(exact, 0.0))
    result = replay_bag(case / "bag", stage)
    (blocks,) = BagReader(case / "bag").read_blocks(["/stage/lvdt/samples"]).values()
    times = np.concatenate([block.times_ns for block in blocks])
    radial = np.concatenate([block.columns(("radial_x", "radial_y")) for block in blocks])
    found = compare_radial(result.stamp_ns, result.motion, stage.lvdt, times, radial, PERIOD)
    assert len(found.stamp_ns) > 0.99 * 39_900
    assert found.rms <= 0.10e-6
    assert found.maximum <= 0.5e-6
    assert 0.93 <= found.inside <= 0.97


@pytest.mark.cases("open", "stage", "null", most=1)
def test_the_command_writes_the_arrays(case, tmp_path, capsys):
    out = tmp_path / "out.npz"
    assert main(["replay", str(case / "bag"), "--twin", str(case / "twin.yaml"), "-o", str(out)]) == 0
    with np.load(out) as found:
        count = len(found["stamp_ns"])
        assert found["theta"].shape == (count,)
        assert found["error_motion"].shape == (count, 6)
        assert found["covariance"].shape == (count, 6, 6)
        assert "tool_offset" not in found
        assert np.isnan(found["error_motion"][:, 2]).all()  # no sensor sees axial motion
        assert np.isfinite(found["error_motion"][:, [0, 1, 3, 4]]).all()
    assert f"{count} estimates over" in capsys.readouterr().out


@pytest.mark.cases("rough_open", "stage", "null", most=2)
def test_lost_blocks_and_turbulence_cost_no_estimate(case):
    result = replay_bag(case / "bag", load_stage(case / "twin.yaml"))
    assert np.diff(result.stamp_ns).max() == PERIOD
    assert result.status.withheld == 0


@pytest.mark.cases("open", "stage", "null", most=1)
def test_a_torn_bag_gives_what_is_readable_and_says_so(case, tmp_path, capsys):
    torn = tmp_path / "bag"
    shutil.copytree(case / "bag", torn)
    (torn / "bag.mcap").chmod(0o644)
    whole = (torn / "bag.mcap").read_bytes()
    (torn / "bag.mcap").write_bytes(whole[: len(whole) // 2])
    arguments = ["replay", str(torn), "--twin", str(case / "twin.yaml"), "-o", str(tmp_path / "out.npz")]
    assert main(arguments) == 0
    assert "was not closed; readable are" in capsys.readouterr().err


@pytest.mark.cases("open", "machine", "null", most=1)
def test_a_bag_without_heads_is_refused_and_named(case, tmp_path):
    with pytest.raises(InputError, match=r"no message on /stage/head_a/samples, .*the bag has /machine"):
        replay_bag(case / "bag", load_stage())


def test_wrong_arguments_end_with_code_2(tmp_path, capsys):
    out = str(tmp_path / "out.npz")
    assert main(["replay", str(tmp_path / "nothing"), "-o", out]) == 2
    assert "no such bag" in capsys.readouterr().err
    assert main(["replay", str(tmp_path), "-o", out, "--period-ms", "0"]) == 2
    assert "--period-ms is 0.0; it must be from 0.01 to 1000" in capsys.readouterr().err


@pytest.mark.cases("open", "stage", "null", most=1)
def test_a_file_that_cannot_be_written_is_named(case, tmp_path, capsys):
    out = str(tmp_path / "no" / "out.npz")
    assert main(["replay", str(case / "bag"), "--twin", str(case / "twin.yaml"), "-o", out]) == 2
    assert "cannot be written" in capsys.readouterr().err


def test_both_forms_of_the_machine_model_replay_alike_and_the_slower_one_is_told(tmp_path, capsys):
    bag = write_mock_bag(tmp_path / "bag", samples=8_000)
    found = []
    for form in [*(["compiled"] if is_built() else []), "numpy"]:
        with computing_by(form):
            assert main(["replay", str(bag), "--machine", "xyzac_trt", "-o", str(tmp_path / form)]) == 0
        told = capsys.readouterr().err
        assert ("computed by numpy, which is slower" in told) == (form == "numpy")
        with np.load(tmp_path / form) as arrays:
            found.append({name: arrays[name] for name in arrays.files})
    first, last = found[0], found[-1]
    assert np.isfinite(first["tool_offset"]).any() and len(first["corrections"]) > 50
    for name, array in first.items():
        np.testing.assert_allclose(array, last[name], rtol=1e-12, atol=2e-15, err_msg=name)
