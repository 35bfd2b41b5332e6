"""The page in NiceGUI: it puts the drawn parts where they belong and sends each one again when it has changed.

NiceGUI and no Panel: its page lives on one websocket that comes back by itself, its assets are all in its wheel, and it
starts in half a second with buttons and dialogues for a finger. Panel brings Bokeh, whose model of a document for each
browser costs memory by the browser and draws curves of thousands of points that nobody needs of 360 angles.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

from rotary_error_monitor.dashboard.board import Action, PageBoard
from rotary_error_monitor.dashboard.style import BEAT_PERIOD, SCRIPT, STYLE
from rotary_error_monitor.errors import InputError

LOOK_PERIOD = 0.2
"""s between two looks for something new: no browser draws more often than this."""

_SECTIONS = (
    ("", "whole top", ("verdict",)),
    ("Error motion", "", ("figures",)),
    ("Polar plot, last turns", "", ("polar",)),
    ("Orbit of the axis of rotation", "", ("orbit",)),
    ("Tool offset before and after correction", "", ("offset",)),
    ("Corrections and limits", "wide", ("correction",)),
    ("Recording", "", ("recording",)),
    ("Gap between twin and measurement", "", ("gap",)),
    ("Largest of each minute, 24 h", "most trend", ("trend_radial", "trend_offset")),
    ("Nodes and streams", "whole", ("health",)),
)
"""Heading, classes and parts of each section."""


def application(board: Callable[[], PageBoard | None]) -> Any:  # noqa: ANN401 (an ASGI application)
    """The application that serves the page of the board that there is when a browser asks.

    NiceGUI has one application a process, and so has whoever calls this: it is made once.

    Raises:
        InputError: NiceGUI is not installed.
    """
    try:
        from fastapi import FastAPI
        from nicegui import app, core, ui
    except ImportError:
        raise InputError(
            "the dashboard needs the package nicegui: pip install 'rotary_error_monitor[dashboard]'"
        ) from None

    def root() -> None:
        found = board()
        if found is None:
            ui.label("The dashboard is not active.")
        else:
            _build(found)

    ui.page("/")(root)
    # The application itself is served, as by `ui.run`, which would take the signals. One that carries it looks for its
    # server among all objects of the process: a tuple that another thread is about to build fails by that.
    ui.run_with(
        FastAPI(),
        title="rotary_error_monitor",
        reconnect_timeout=3.0,
        message_history_length=0,  # after a break the page loads anew: nothing is kept for browsers that are gone
        tailwind=False,
        show_welcome_message=False,
        binding_refresh_interval=None,
    )
    core.sio.eio.cors_allowed_origins = None  # a page of another host opens no socket here
    return app


def begin_anew() -> None:
    """Before each start of the server: what the last one looked after ended with its event loop."""
    from nicegui import core

    core.sio.eio.start_service_task = True


def _build(board: PageBoard) -> None:
    """One browser's page."""
    from nicegui import ui

    ui.add_css(STYLE)
    ui.add_head_html(f"<script>{SCRIPT}</script>")
    ui.html("NO CONNECTION to the dashboard. What stands below is old. Trying again …", sanitize=False).classes(
        "cut-line"
    )
    beat = ui.html("0", sanitize=False).classes("beat")
    parts, shown = board.look(), {}
    with ui.element("div").classes("cell"):
        for heading, classes, names in _SECTIONS:
            with ui.element("section").classes(classes):
                if heading:
                    ui.html(heading, sanitize=False, tag="h2")
                for name in names:
                    shown[name] = ui.html(parts.get(name, ""), sanitize=False).classes(f"part-{name}")
                    for action in board.actions:
                        if action.place == name:
                            _button(action)
    beats = itertools.count(1)

    def look() -> None:
        for name, text in board.look().items():
            if shown[name].content is not text:
                shown[name].content = text

    def live() -> None:
        beat.content = f"{next(beats)} {board.drawn}"

    ui.timer(LOOK_PERIOD, look)
    ui.timer(BEAT_PERIOD, live)


def _button(action: Action) -> None:
    """A button that asks before it acts, and says what came of it."""
    from nicegui import ui

    with ui.dialog() as dialog, ui.card():
        ui.label(action.question)
        with ui.row():
            ui.button("Cancel", on_click=dialog.close).props("outline size=lg")
            ui.button("Yes", on_click=lambda: dialog.submit(True)).props("size=lg color=deep-orange-10")

    async def ask() -> None:
        if await dialog:
            ui.notify(await action.act(), timeout=8000, position="top")

    with ui.element("div").classes("act"):
        ui.button(action.label, on_click=ask).props("no-caps color=blue-grey-9")
