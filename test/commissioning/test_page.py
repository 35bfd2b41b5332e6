"""The page of a commissioning: all that is said, with pictures, in one file; also of what is not written."""

from __future__ import annotations

import html
import re
from pathlib import Path

import numpy as np
import pytest
from world.newly_built import NewlyBuilt, build, in_unit
from world.recording import head_topic

from commissioning.bags import run, written


@pytest.fixture(scope="module")
def built() -> NewlyBuilt:
    """Two heads swapped, one reversed."""
    return build(11, count=4, even=False, swap=True, duration=24.0)


def parts(text: str) -> dict[str, str]:
    """What stands under each heading, without tags."""
    plain = re.sub(r"<img [^>]*>", "", text)
    _, *found = re.split(r"<h2>(.*?)</h2>", plain)
    strip = {name: re.sub(r"<[^>]+>", "\n", each) for name, each in zip(found[::2], found[1::2], strict=True)}
    strip = {name: each.replace("\xa0", " ") for name, each in strip.items()}
    return {html.unescape(name): html.unescape(each) for name, each in strip.items()}


def test_a_page_says_what_is_said_and_loads_nothing(
    built: NewlyBuilt, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, nominal = written(built, tmp_path)
    assert run(bag, nominal, tmp_path / "stage.yaml", "--page", str(tmp_path / "page.html")) == 0
    said, text = capsys.readouterr().out, (tmp_path / "page.html").read_text(encoding="utf-8")
    pages = parts(text)
    wrong = re.findall(r"^  (\S.*) \(put right in the stage file\)$", said, re.MULTILINE)
    assert len(wrong) >= 2 and all(each in pages["What is wrong"] for each in wrong)
    found = said.partition("what was found")[2].partition("what this recording cannot tell")[0].splitlines()[1:]
    heads = [line for line in found if re.match("  head [a-h]: azimuth", line)]
    assert len(found) >= 7 and len(heads) == 4
    shown = pages["What was found (± standard uncertainty)"]
    assert all(line.strip() in shown for line in found if line not in heads)
    for line in heads:
        values = re.findall(r"-?[\d.]+ ± [\d.]+|[-+]1\b", line)
        assert len(values) == 4 and all(f"\n{value}\n" in shown for value in values)
    assert f"{len(wrong)} things are otherwise than described; the stage file puts all of them right" in text
    pictures = re.findall(r"src='data:image/png;base64,([A-Za-z0-9+/=]+)'", text)
    assert len(pictures) == 3 and all(len(picture) > 5_000 for picture in pictures)
    assert not re.search(r"(src|href)='?http|@import|url\(", text)
    assert not list(tmp_path.glob(".page*")), "nothing half-written stays"


def test_what_is_not_written_has_a_page_that_says_why(built: NewlyBuilt, tmp_path: Path) -> None:
    degrees = in_unit(built.recording, [head_topic("b")], 180 / np.pi)
    bag, nominal = written(built, tmp_path, degrees)
    assert run(bag, nominal, tmp_path / "stage.yaml", "--page", str(tmp_path / "page.html")) == 10
    assert not (tmp_path / "stage.yaml").exists()
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "✗ Not settled" in text and "that the stage file does not put right: head b reads degrees" in text


def test_wrong_input_leaves_the_page_that_was_there(built: NewlyBuilt, tmp_path: Path) -> None:
    bag, nominal = written(built, tmp_path)
    (tmp_path / "page.html").write_text("before", encoding="utf-8")
    nominal.write_text("stage: {}\n", encoding="utf-8")
    assert run(bag, nominal, tmp_path / "stage.yaml", "--page", str(tmp_path / "page.html")) == 2
    assert (tmp_path / "page.html").read_text(encoding="utf-8") == "before"
    assert run(bag, nominal, tmp_path / "stage.yaml", "--page", str(bag)) == 2
