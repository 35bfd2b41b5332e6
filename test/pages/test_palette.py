"""Colours of pages and pictures are told apart by everybody, and no page has others."""

from __future__ import annotations

import base64
import io
import itertools
import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from pages.conftest import KINDS
from PIL import Image

from rotary_error_monitor.report.palette import LINES, PALETTE, colour

REPORT = Path(__file__).parents[2] / "rotary_error_monitor" / "report"

LEAST = 15.0
"""Difference of any two colours (CIE 1976); 2.3 is just noticeable side by side."""

SEEN = {
    "all cones": np.eye(3),
    "no red cones": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "no green cones": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "no blue cones": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
}
"""Linear RGB as seen (Machado, Oliveira and Fernandes 2009, severity 1.0)."""


def rgb(colour: str) -> NDArray[np.float64]:
    return np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)], np.float64)


def lab(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """CIE L*a*b* of linear sRGB, white D65."""
    to_xyz = np.array(
        [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.072175], [0.0193339, 0.119192, 0.9503041]]
    )
    relative = to_xyz @ np.clip(linear, 0, 1) / (to_xyz @ np.ones(3))
    f = np.where(relative > (6 / 29) ** 3, np.cbrt(relative), relative / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def difference(one: str, other: str, who: str) -> float:
    def seen(each: str) -> NDArray[np.float64]:
        part = rgb(each) / 255
        return lab(np.asarray(SEEN[who]) @ np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4))

    return float(np.linalg.norm(seen(one) - seen(other)))


@pytest.mark.parametrize("who", SEEN)
def test_any_two_colours_differ_for_everybody(who: str) -> None:
    for one, other in itertools.combinations(PALETTE, 2):
        assert difference(one, other, who) > LEAST, (one, other)


@pytest.mark.parametrize("who", SEEN)
def test_each_is_seen_on_white(who: str) -> None:
    assert all(difference(each, "#ffffff", who) > 2 * LEAST for each in PALETTE)


def test_the_simulation_is_that_of_the_paper() -> None:
    """White stays white; red and green, which differ most, come together for who lacks the cones of one."""
    for who, matrix in SEEN.items():
        np.testing.assert_allclose(np.asarray(matrix) @ np.ones(3), 1.0, atol=2e-6)
        assert difference("#ffffff", "#000000", who) == pytest.approx(100.0, abs=0.01)
    whole = difference("#d62728", "#2ca02c", "all cones")
    assert difference("#d62728", "#2ca02c", "no green cones") < 0.4 * whole
    assert difference("#d62728", "#2ca02c", "no blue cones") > 0.8 * whole


def test_lines_take_them_one_after_another() -> None:
    assert [colour(k) for k in range(len(LINES))] == list(LINES) and colour(len(LINES)) == LINES[0]
    assert len(set(PALETTE)) == len(PALETTE)


@pytest.mark.parametrize("path", sorted(REPORT.glob("*.py")), ids=lambda path: path.name)
def test_no_picture_has_a_colour_of_its_own(path: Path) -> None:
    """Greys of paper and ink aside, colours stand in one place."""
    text = path.read_text(encoding="utf-8")
    found = re.findall(r"#[0-9a-f]{6}\b|#[0-9a-f]{3}\b|\b(?:tab|xkcd):\w+|\bC\d\b", text)
    assert path.stem == "palette" or [each for each in found if not is_grey(each)] == []


def is_grey(colour: str) -> bool:
    parts = (
        rgb(colour if len(colour) == 7 else "#" + "".join(2 * c for c in colour[1:])) if colour[0] == "#" else [0, 99]
    )
    return bool(np.ptp(parts) < 12)


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_coloured_in_a_picture_is_of_the_palette(pages: dict[str, Path], kind: str) -> None:
    """Each frequent colour lies between one of the palette, or a blend of two that overlap, and white paper."""
    text = pages[kind].read_text(encoding="utf-8")
    for encoded in re.findall(r"src='data:image/png;base64,([A-Za-z0-9+/=]+)'", text):
        image = Image.open(io.BytesIO(base64.b64decode(encoded)))
        dots = np.array(image.getpalette()).reshape(-1, 3)
        counts = np.array(image.histogram())[: len(dots)]
        coloured = np.ptp(dots, axis=1) > 30
        frequent = coloured & (counts > 0.05 * counts[coloured].sum())
        assert counts.sum() == image.width * image.height
        for dot in dots[frequent].astype(float):
            assert min(beside(dot, rgb(each)) for each in PALETTE) < 12.0, dot


def beside(dot: NDArray[np.float64], colour: NDArray[np.float64]) -> float:
    """Distance of a colour from the line between another and white."""
    way = colour - 255.0
    part = np.clip((dot - 255.0) @ way / (way @ way), 0.0, 1.0)
    return float(np.linalg.norm(dot - 255.0 - part * way))
