"""Draw the flowcharts of the pages as SVG, so that who reads them needs no program that draws.

    python -m website.flowcharts FOLDER

Of mermaid it knows what the pages use: `flowchart LR` (or RL, TB, BT), chains `a --> b`, `a & b`, labels `a[text]`, and
arrows with text, `-- text -->`.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from html import escape
from pathlib import Path

BLOCK = re.compile(r"```mermaid\n(.*?)```", re.DOTALL)
_ARROW = re.compile(r"\s+(?:--\s+(.+?)\s+)?-->\s+")
_NODE = re.compile(r"^(\w+)(?:\[(.+)\])?$")
_LETTER, _LINE, _PAD, _MARGIN = 7.6, 30.0, 12.0, 12.0
"""Width of a letter, height of a box, space beside its text and around the picture, in px of a 14 px font."""

Point = tuple[float, float]


@dataclass(frozen=True)
class Flowchart:
    """Labels of nodes by their names, and arrows with their texts."""

    direction: str
    labels: dict[str, str]
    arrows: list[tuple[str, str, str]]


def parse(text: str) -> Flowchart:
    """Read a flowchart.

    Raises:
        ValueError: naming a line that this does not understand.
    """
    first, *lines = [line.strip() for line in text.strip().splitlines()]
    heading = re.fullmatch(r"flowchart (LR|RL|TB|BT)", first)
    if heading is None:
        raise ValueError(f"{first!r}: expected flowchart LR, RL, TB or BT")
    labels: dict[str, str] = {}
    arrows: list[tuple[str, str, str]] = []
    for line in lines:
        parts = _ARROW.split(line)
        groups = [[_node(word, labels, line) for word in re.split(r"\s+&\s+", part)] for part in parts[::2]]
        for index, told in enumerate(parts[1::2]):
            arrows += [(a, b, (told or "").strip('"')) for a in groups[index] for b in groups[index + 1]]
    return Flowchart(heading[1], labels, arrows)


def _node(word: str, labels: dict[str, str], line: str) -> str:
    found = _NODE.match(word.strip())
    if found is None:
        raise ValueError(f"{line!r}: {word!r} is no name and no name[label]")
    name, label = found.groups()
    labels[name] = label.strip('"') if label else labels.get(name, name)
    return name


class _Box:
    """What grandalf lays out: as wide and high as it is along the direction of the flow."""

    def __init__(self, width: float, height: float, *, across: bool) -> None:
        self.width, self.height = width, height
        self.w, self.h = (height, width) if across else (width, height)
        self.xy: Point = (0.0, 0.0)


def draw(chart: Flowchart) -> str:
    """The chart as SVG.

    Raises:
        ValueError: it is not connected.
    """
    # a tool of `make docs` alone: what is drawn can be read without it
    from grandalf.graphs import Edge, Graph, Vertex
    from grandalf.layouts import SugiyamaLayout
    from grandalf.routing import EdgeViewer, route_with_lines

    across = chart.direction in ("LR", "RL")
    vertices = {name: Vertex(name) for name in chart.labels}
    for name, vertex in vertices.items():
        vertex.view = _Box(len(chart.labels[name]) * _LETTER + 2 * _PAD, _LINE, across=across)
    edges = [Edge(vertices[a], vertices[b], data=told) for a, b, told in chart.arrows]
    for edge in edges:
        edge.view = EdgeViewer()
    components = Graph(list(vertices.values()), edges).C
    if len(components) != 1:
        raise ValueError(f"the flowchart has {len(components)} parts; expected one")
    layout = SugiyamaLayout(components[0])
    layout.route_edge = route_with_lines
    layout.xspace, layout.yspace = 22.0, 130.0 if any(told for *_, told in chart.arrows) and across else 42.0
    layout.init_all()
    layout.draw(5)
    boxes = {name: (vertex.view, _turned(vertex.view.xy, chart.direction)) for name, vertex in vertices.items()}
    ways = [(edge.data, [_turned(point, chart.direction) for point in edge.view._pts]) for edge in edges]
    return _svg(boxes, ways, chart.labels)


def _turned(point: Point, direction: str) -> Point:
    x, y = point
    return {"TB": (x, y), "BT": (x, -y), "LR": (y, x), "RL": (-y, x)}[direction]


def _svg(boxes: dict[str, tuple[_Box, Point]], ways: Iterable[tuple[str, list[Point]]], labels: dict[str, str]) -> str:
    ways = list(ways)
    xs = [x + side * box.width / 2 for box, (x, _) in boxes.values() for side in (-1, 1)]
    ys = [y + side * box.height / 2 for box, (_, y) in boxes.values() for side in (-1, 1)]
    xs += [x for _, way in ways for x, _ in way]
    ys += [y for _, way in ways for _, y in way]
    left, top = min(xs) - _MARGIN, min(ys) - _MARGIN
    width, height = max(xs) - left + _MARGIN, max(ys) - top + _MARGIN
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{left:.1f} {top:.1f} {width:.1f} {height:.1f}" '
        f'width="{width:.0f}" font-family="sans-serif" font-size="14" text-anchor="middle">',
        f'<rect x="{left:.1f}" y="{top:.1f}" width="{width:.1f}" height="{height:.1f}" fill="#fff"/>',
        '<marker id="end" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="8" orient="auto">'
        '<path d="M0 0L8 4L0 8z" fill="#666"/></marker>',
        *(line for told, way in ways for line in _arrow(told, way)),
        *(line for name, (box, at) in boxes.items() for line in _box(box, at, labels[name])),
    ]
    return "\n".join([*parts, "</svg>\n"])


def _arrow(told: str, way: list[Point]) -> Iterator[str]:
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in way)
    yield f'<polyline points="{points}" fill="none" stroke="#666" marker-end="url(#end)"/>'
    if told:
        (ax, ay), (bx, by) = way[0], way[1]
        yield (
            f'<text x="{(ax + bx) / 2:.1f}" y="{(ay + by) / 2 - 4:.1f}" font-size="11" fill="#444" stroke="#fff" '
            f'stroke-width="3" paint-order="stroke">{escape(told)}</text>'
        )


def _box(box: _Box, at: Point, label: str) -> Iterator[str]:
    x, y = at
    left, top = x - box.width / 2, y - box.height / 2
    yield (
        f'<rect x="{left:.1f}" y="{top:.1f}" width="{box.width:.1f}" height="{box.height:.1f}" '
        'rx="4" fill="#eef0fb" stroke="#5c6bc0"/>'
    )
    yield f'<text x="{x:.1f}" y="{y + 5:.1f}">{escape(label)}</text>'


def draw_all(folder: Path) -> int:
    """Put a picture in place of each flowchart of the pages below `folder`; give how many there were."""
    count = 0
    for page in sorted(folder.rglob("*.md")):
        text = page.read_text(encoding="utf-8")
        for number, block in enumerate(BLOCK.findall(text), 1):
            name = f"{page.stem}_flow{number}.svg"
            (page.parent / name).write_text(draw(parse(block)), encoding="utf-8")
            text = text.replace(f"```mermaid\n{block}```", f"![flowchart]({name})")
            count += 1
        page.write_text(text, encoding="utf-8")
    return count


if __name__ == "__main__":
    draw_all(Path(sys.argv[1]))
