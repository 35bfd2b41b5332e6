"""What notebooks get is what the commands write, to the last bit, as tables, figures and files alike."""

from __future__ import annotations

import csv
import dataclasses
import json
import pickle
import re
from collections.abc import Mapping

import numpy as np
import pandas
import pytest
from mock_bags import write_mock_bag

from rotary_error_monitor import estimate, read_bag
from rotary_error_monitor.cli import main
from rotary_error_monitor.metrology.error_motion import COMPONENTS
from rotary_error_monitor.resources import config

STAGE, MACHINE = config("stage.yaml"), "xyzac_trt"
MADE = re.compile(r"\d{4}-\d\d-\d\d \d\d:\d\d UTC")
"""When a page was made, which is the one thing in it that is another each time."""


@pytest.fixture(scope="module")
def machine_bag(tmp_path_factory):
    return write_mock_bag(tmp_path_factory.mktemp("machine") / "bag", 8_000)


def without_date(path):
    return MADE.sub("", path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("machine", [None, MACHINE])
def test_estimate_is_what_replay_writes(machine, machine_bag, tmp_path):
    named = [] if machine is None else ["--machine", machine]
    assert main(["replay", str(machine_bag), *named, "-o", str(tmp_path / "command.npz")]) == 0
    found = estimate(read_bag(machine_bag), machine=machine)
    found.save(tmp_path / "own.npz")
    assert (found.tool_offset is None) == (machine is None)
    with np.load(tmp_path / "command.npz") as one, np.load(tmp_path / "own.npz") as other:
        assert one.files == other.files
        for name in one.files:
            assert one[name].tobytes() == other[name].tobytes(), name
        given = {"stamp_ns": found.stamp_ns, "theta": found.theta, "error_motion": found.error_motion}
        given |= {"covariance": found.covariance} | ({} if machine is None else {"tool_offset": found.tool_offset})
        for name, array in given.items():
            assert one[name].tobytes() == array.tobytes(), name
    assert machine is None or np.isfinite(found.tool_offset).any()


def test_analyse_is_what_the_command_writes(bag, quality, limits, tmp_path):
    arguments = ["analyse", str(bag), "--height", "60", "--format", "html,json,csv"]
    words = [f"{name}={value}" for name, value in limits.items()]
    assert main([*arguments, "--limits", *words, "-o", str(tmp_path / "command.html")]) == 10
    for suffix in ("html", "json", "csv"):  # the page holds the pictures
        quality.save(tmp_path / f"own.{suffix}")
        assert without_date(tmp_path / f"own.{suffix}") == without_date(tmp_path / f"command.{suffix}")
    content = json.loads((tmp_path / "command.json").read_text(encoding="utf-8"))
    table = quality.to_dataframe()
    assert len(table) == len(content["figures"]) > 40
    for name, key in (("quantity", "name"), ("segment", "segment"), ("value", "value"), ("unit", "unit")):
        assert table[name].tolist() == [figure[key] for figure in content["figures"]]
    told = [figure["expanded_uncertainty"] for figure in content["figures"]]
    assert table["U95"].tolist() == pytest.approx([np.nan if u is None else u for u in told], rel=0, abs=0, nan_ok=True)


def test_diagnose_is_what_the_command_writes(bag, gap, tmp_path, capsys):
    code = main(["diagnose", str(bag), "--twin", str(STAGE), "-o", str(tmp_path)])
    assert code == gap.outcome.exit_code
    assert capsys.readouterr().out.strip() == gap.verdict
    for suffix in ("json", "html"):  # the page holds the picture
        gap.save(tmp_path / f"own.{suffix}")
        assert without_date(tmp_path / f"own.{suffix}") == without_date(tmp_path / f"diagnosis.{suffix}")
    # what the cell shows is the command's picture, which another process has drawn
    assert gap.figures()._repr_png_()[0] == (tmp_path / "diagnosis.png").read_bytes()
    causes = json.loads((tmp_path / "diagnosis.json").read_text(encoding="utf-8"))["causes"]
    table = gap.to_dataframe()
    assert list(dict.fromkeys(table["effect"])) == [cause["effect"] for cause in causes] != []
    for cause in causes:
        rows = table[(table["effect"] == cause["effect"]) & (table["location"] == cause["location"])]
        assert set(rows["probability"]) == {cause["probability"]}
        for name, told in cause["parameters"].items():
            own = rows[rows["parameter"] == name]
            assert own["value"].tolist() == np.atleast_1d(told["value"]).tolist()
            assert own["sigma"].tolist() == np.atleast_1d(told["std"]).tolist()


def test_no_cause_is_a_table_without_rows(gap):
    nothing = dataclasses.replace(gap, result=dataclasses.replace(gap.result, causes=()))
    assert nothing.to_dataframe().empty
    assert list(nothing.to_dataframe().columns) == list(gap.to_dataframe().columns)


def test_tables_over_time_have_utc_and_units(motion):
    table, small = motion.to_dataframe(), motion.to_dataframe(units="um")
    assert isinstance(table.index, pandas.DatetimeIndex) and str(table.index.tz) == "UTC"
    assert table.index.as_unit("ns").asi8.tolist() == motion.stamp_ns.tolist()
    for i, name in enumerate(COMPONENTS):
        np.testing.assert_array_equal(table[name], motion.error_motion[:, i])
        np.testing.assert_array_equal(small[f"sigma_{name}"], 1e6 * motion.sigma[:, i])
        assert table.attrs["units"][name] == ("m" if i < 3 else "rad")
        assert small.attrs["units"][f"sigma_{name}"] == ("µm" if i < 3 else "µrad")
    assert table["ezc"].isna().all() and not motion.observable[:, 2].any()
    np.testing.assert_array_equal(small["theta"], table["theta"])
    assert small.attrs["units"]["theta"] == "rad"


def test_verdicts_of_values_follow_from_value_and_uncertainty(quality, limits):
    """By hand: within with U, beyond without it, else open (ISO 14253-1), and of no value without a limit."""
    table, small = quality.to_dataframe(), quality.to_dataframe(units="um")
    size = {"m": 1e-6, "rad": 1e-6}
    seen = set()
    for row in table.itertuples():
        signal, _, figure = row.quantity.partition(".")
        name = f"{signal.partition('_')[0]}_{figure}"
        given = [value for limit, value in limits.items() if limit.rpartition("_")[0] == name]
        if not given:
            assert np.isnan(row.limit) and pandas.isna(row.verdict), row.quantity
            continue
        assert row.limit == pytest.approx(given[0] * size[row.unit], rel=1e-12)
        is_within, is_beyond = row.value + row.U95 <= row.limit, row.value - row.U95 > row.limit
        assert row.verdict == ("within" if is_within else "beyond" if is_beyond else "open")
        seen.add(row.verdict)
    assert {"within", "beyond"} <= seen
    is_size = table["unit"].isin(["m", "rad", "m/K", "rad/K"])
    np.testing.assert_array_equal(small.loc[is_size, "value"], 1e6 * table.loc[is_size, "value"])
    np.testing.assert_array_equal(small.loc[~is_size, "value"], table.loc[~is_size, "value"])
    assert set(small.loc[is_size, "unit"]) <= {"µm", "µrad", "µm/K", "µrad/K"}


def arrays_of(value):
    """All arrays in a result, and in what its fields hold."""
    if isinstance(value, np.ndarray):
        yield value
    elif dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            yield from arrays_of(getattr(value, field.name))
    elif isinstance(value, Mapping):
        yield from arrays_of(tuple(value.values()))
    elif isinstance(value, tuple | list):
        for part in value:
            yield from arrays_of(part)


@pytest.mark.parametrize("what", ["recording", "motion", "radial", "quality", "gap"])
def test_results_are_frozen_and_arrays_read_only(what, recording, motion, quality, gap):
    radial = motion.at_height(0.06)
    result = {"recording": recording, "motion": motion, "quality": quality, "gap": gap, "radial": radial}[what]
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(result, dataclasses.fields(result)[0].name, None)
    with pytest.raises((AttributeError, TypeError)):  # no place for another one
        result.another = 1
    # of a diagnosis the picture: values of causes belong to what found them
    found = list(arrays_of({"quality": quality.result, "gap": gap.picture}.get(what, result)))
    own = [name for name, each in vars(type(result)).items() if isinstance(each, property)]
    found += [value for name in own if isinstance(value := getattr(result, name), np.ndarray)]
    assert found and not any(array.flags.writeable for array in found)
    with pytest.raises(ValueError, match="read-only"):
        found[0][...] = 0


def test_mappings_do_not_change_and_results_can_be_pickled(recording, motion, quality, gap):
    for mapping in (recording.streams, motion.used, motion.doubts):
        with pytest.raises(TypeError):
            mapping["head_a"] = None
    again = pickle.loads(pickle.dumps((recording, motion, quality, gap)))
    assert again[0].streams.keys() == recording.streams.keys()
    np.testing.assert_array_equal(again[1].error_motion, motion.error_motion)
    assert (again[2].verdict, again[3].verdict) == (quality.verdict, gap.verdict)


def test_a_changed_table_leaves_the_result_as_it_is(motion):
    table = motion.to_dataframe()
    before = motion.error_motion.tobytes()
    table.loc[:, "exc"] = 1.0
    assert motion.error_motion.tobytes() == before


def test_csv_and_table_are_one(quality, tmp_path):
    quality.save(tmp_path / "out.csv")
    rows = list(csv.DictReader((tmp_path / "out.csv").read_text(encoding="utf-8").splitlines()))
    table = quality.to_dataframe()
    for name in ("turns", "cut_off"):
        assert [row[name] for row in rows] == ["" if pandas.isna(cell) else str(cell) for cell in table[name]]
