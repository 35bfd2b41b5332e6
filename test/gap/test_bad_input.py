"""What users may give the command by mistake: each a clear sentence and exit code 2, never a traceback."""

from __future__ import annotations

import shutil
import sys

import numpy as np
import pytest

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.blind_check.cases import draw_machine, write_case
from rotary_error_monitor.cases.making import make_machine_case, make_stage_case
from rotary_error_monitor.cli import main
from rotary_error_monitor.codec.contents import PointStamped
from rotary_error_monitor.effects.library import ENTRY_POINTS, load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.errors import InputError

EFFECT = """
from rotary_error_monitor.effects.effect import Parameter
from rotary_error_monitor.effects.rotor import StageEffect


class Offset(StageEffect):
    name = "my_offset"
    parameters = (Parameter("offset", "rad", 1e-6),)
    acts_on = ("autocollimator",)

    def measured(self, values, location, state, ideal):
        return ideal + values[0]
"""
LAST_LINE = "return ideal + values[0]"


@pytest.fixture(scope="module")
def stage_case(tmp_path_factory):
    folder = tmp_path_factory.mktemp("stage") / "case"
    write_case(make_stage_case(5, "single", ["mirror_wobble"], (150.0, 300.0), duration=20.0), folder)
    return folder


@pytest.fixture(scope="module")
def machine_case(tmp_path_factory):
    folder = tmp_path_factory.mktemp("machine") / "case"
    write_case(make_machine_case(draw_machine(5), 5, "null"), folder)
    return folder


@pytest.fixture
def refused(capsys, tmp_path):
    """Function that runs the command, expects exit code 2 and no results, and gives what was said."""

    def run(bag, twin, *options, out=tmp_path / "out"):
        assert main(["diagnose", str(bag), "--twin", str(twin), "-o", str(out), "--no-report", *map(str, options)]) == 2
        assert not (out / "diagnosis.json").is_file()
        told = capsys.readouterr()
        assert not told.out and "Traceback" not in told.err
        return told.err

    return run


def test_a_bag_without_several_topics_names_them_all(stage_case, tmp_path, refused):
    topics = BagReader(stage_case / "bag").read_blocks()
    for name in ("head_a", "autocollimator", "command"):
        del topics[f"/stage/{name}/samples"]
    write_messages(tmp_path / "bag", topics)
    told = refused(tmp_path / "bag", stage_case / "twin.yaml")
    assert "no message on /stage/head_a/samples, /stage/autocollimator/samples, /stage/command/samples" in told
    assert "the bag has /stage/head_b/samples" in told


def test_a_bag_of_a_machine_beside_the_twin_of_a_stage(stage_case, machine_case, refused):
    told = refused(machine_case / "bag", stage_case / "twin.yaml")
    assert "no message on /stage/head_a/samples" in told and "the bag has /machine/joint_states" in told
    assert "no message on /machine/joint_states" in refused(stage_case / "bag", machine_case / "twin.yaml")


def test_the_twin_of_another_stage_is_told_without_a_ranking(stage_case, tmp_path, refused):
    write_case(make_stage_case(6, "null", duration=20.0), tmp_path / "other")
    told = refused(stage_case / "bag", tmp_path / "other" / "twin.yaml")
    assert "It describes another stage; give the twin of this one" in told
    assert "mirror_wobble" not in told


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_machine_bag_with_numbers_that_are_none(machine_case, tmp_path, refused, value):
    contents = BagReader(machine_case / "bag").read()
    probe = contents["/machine/tool_probe"][7]
    contents["/machine/tool_probe"][7] = PointStamped(probe.stamp_ns, np.array([0.0, value, 0.0]))
    write_messages(tmp_path / "bag", contents)
    told = refused(tmp_path / "bag", machine_case / "twin.yaml")
    assert "/machine/tool_probe" in told or "probe at" in told
    assert str(probe.stamp_ns) in told and "finite" in told


@pytest.mark.parametrize(("part", "problem"), [(0.02, "200 are needed"), (0.3, "too little to hold data out")])
def test_a_bag_torn_too_early_says_how_much_is_readable(stage_case, tmp_path, refused, part, problem):
    shutil.copytree(stage_case / "bag", tmp_path / "bag")
    (file,) = (tmp_path / "bag").glob("*.mcap")
    content = file.read_bytes()
    file.write_bytes(content[: int(part * len(content))])
    told = refused(tmp_path / "bag", stage_case / "twin.yaml")
    assert problem in told
    assert "was not closed; readable are" in told and f"of {int(part * len(content))} bytes" in told


def test_a_twin_without_a_key_names_file_line_and_key(stage_case, tmp_path, refused):
    lines = (stage_case / "twin.yaml").read_text(encoding="utf-8").splitlines()
    kept = [line for line in lines if "disc_radius" not in line]
    (tmp_path / "twin.yaml").write_text("\n".join(kept), encoding="utf-8")
    assert "twin.yaml:2: stage.encoder: 'disc_radius'" in refused(stage_case / "bag", tmp_path / "twin.yaml")


def test_results_that_cannot_be_written_are_told(stage_case, tmp_path, refused):
    (tmp_path / "file").write_text("")
    told = refused(stage_case / "bag", stage_case / "twin.yaml", out=tmp_path / "file" / "out")
    assert f"{tmp_path}/file/out: cannot be written" in told


PLACES = """    def locations(self, stage):
        return {}

"""


@pytest.mark.parametrize(
    ("changed", "problem"),
    [
        ({}, None),
        ({LAST_LINE: "raise KeyError('oops')"}, "effect 'my_offset' of mine fails: KeyError: 'oops'"),
        ({LAST_LINE: "return (ideal + values[0])[1:]"}, "autocollimator gets shape"),
        ({LAST_LINE: "return ideal * float('nan')"}, "autocollimator gets values that are not finite"),
        ({LAST_LINE: "pass"}, "effect 'my_offset' of mine fails: TypeError"),
        ({'    parameters = (Parameter("offset", "rad", 1e-6),)\n': ""}, "effect 'my_offset' has no parameters"),
        ({"    def measured": "    def __init__(self, size): ...\n\n    def measured"}, "made without arguments"),
        ({LAST_LINE: "return ideal + values[0] * 1j"}, "autocollimator gets complex numbers"),
        ({'"my_offset"': "5"}, "name 5 of an effect; expected letters"),
        ({"1e-6": "0.0"}, "parameter 'offset': scale is 0.0; expected its usual size, a finite number above 0"),
        ({"1e-6": "1e-6, bound=-1"}, "parameter 'offset': bound is -1; expected the largest sensible magnitude"),
        ({"1e-6": "1e-6, least=2, bound=1"}, "parameter 'offset': least is 2; expected a number below the bound 1"),
        ({"1e-6": "1e-6, size=0"}, "parameter 'offset': size is 0; expected how many components"),
        ({"1e-6),)": "1e-6))"}, "expected a tuple of Parameter"),
        ({"1e-6),)": '1e-6), Parameter("offset", "rad", 1.0))'}, "parameters offset, offset; expected different names"),
        ({"class Offset": "raise SystemExit(0)\n\nclass Offset"}, "cannot be loaded: SystemExit"),
        ({"    def measured": PLACES.format("exit(0)") + "    def measured"}, "effect 'my_offset' of"),
        (
            {"    def measured": PLACES.format("None") + "    def measured"},
            "locations gives None; expected a tuple of names",
        ),
        ({"    def measured": PLACES.format("'a', 'a'") + "    def measured"}, "expected different names"),
        ({"my_offset": "unbalance"}, "effect 'unbalance' is already known; choose another name"),
        ({"class Offset": "class Offset("}, "cannot be loaded: SyntaxError"),
        (
            {LAST_LINE: "return 1.01 * ideal + values[0]"},
            "with all values 0 it changes the prediction of autocollimator",
        ),
        ({LAST_LINE: "return ideal + (values[0] or float('nan'))"}, "effect 'my_offset' of mine fails"),
    ],
)
def test_a_users_effect_with_a_mistake_is_named(stage_case, tmp_path, refused, changed, problem):
    text = EFFECT
    for old, new in changed.items():
        text = text.replace(old, new)
    (tmp_path / "mine.py").write_text(text, encoding="utf-8")
    options = ("--effects", tmp_path / "mine.py")
    if problem is None:
        paths = [str(stage_case / "bag"), "--twin", str(stage_case / "twin.yaml"), "-o", str(tmp_path / "out")]
        assert main(["diagnose", *paths, "--no-report", *map(str, options)]) == 10
        return
    told = refused(stage_case / "bag", stage_case / "twin.yaml", *options)
    assert problem in told and "mine" in told


def test_a_folder_and_a_missing_file_are_no_effects(stage_case, tmp_path, refused):
    for path in (tmp_path, tmp_path / "nowhere.py"):
        assert "no Python file" in refused(stage_case / "bag", stage_case / "twin.yaml", "--effects", path)


@pytest.fixture
def plug_in(tmp_path, monkeypatch):
    """Function that installs a distribution with one entry point, as pip would leave it."""

    def install(value, text):
        site = tmp_path / "site"
        info = site / "my_effects-1.0.dist-info"
        info.mkdir(parents=True)
        (site / "my_effects.py").write_text(text, encoding="utf-8")
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my-effects\nVersion: 1.0\n", encoding="utf-8")
        (info / "entry_points.txt").write_text(f"[{ENTRY_POINTS}]\nmine = {value}\n", encoding="utf-8")
        monkeypatch.syspath_prepend(str(site))
        monkeypatch.delitem(sys.modules, "my_effects", raising=False)

    return install


def test_an_installed_plug_in_adds_its_effects(plug_in, stage_case, tmp_path, capsys):
    plug_in("my_effects", EFFECT)
    assert "my_offset" in [effect.name for effect in load_effects(StageEffect)]
    arguments = [
        "diagnose",
        str(stage_case / "bag"),
        "--twin",
        str(stage_case / "twin.yaml"),
        "-o",
        str(tmp_path / "o"),
    ]
    assert main([*arguments, "--no-report"]) == 10
    assert "mirror_wobble" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("value", "text", "problem"),
    [
        ("my_effects", "import nothing_like_this", r"'mine' of my-effects: cannot be loaded: ModuleNotFoundError"),
        ("my_effects:Offset", EFFECT, r"'mine' of my-effects: my_effects:Offset is no module"),
        ("my_effects", EFFECT.replace("my_offset", "unbalance"), r"of my-effects: effect 'unbalance' is already known"),
    ],
)
def test_a_plug_in_with_a_mistake_is_named(plug_in, value, text, problem):
    plug_in(value, text)
    with pytest.raises(InputError, match=problem):
        load_effects(StageEffect)
