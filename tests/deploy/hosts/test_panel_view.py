"""The panel on a terminal, and lines where there is none."""

import io
from typing import Any

import pytest
from rich.console import Console

from tis.deploy.hosts.panel import PanelState
from tis.deploy.hosts.panel_view import PanelView

_EVENTS: list[dict[str, Any]] = [
    {"side": "netem", "event": "ready"},
    {"side": "surgeon", "event": "waiting", "whom": "the [b]patient"},
    {"side": "patient", "event": "running", "duration_s": 20.0},
    {"side": "patient", "event": "progress", "now_s": 5.0, "counters": {"received": 7}},
    {"side": "surgeon", "event": "warning", "warning": "[red]late"},
]


@pytest.mark.parametrize("terminal", [True, False])
def test_every_side_its_host_and_warnings_are_shown_as_they_are(terminal: bool) -> None:
    file = io.StringIO()
    console = Console(file=file, force_terminal=terminal, width=100, color_system=None, highlight=False)
    state: Any = {"surgeon": "10.0.0.2", "netem": "10.0.0.1", "patient": "namespace p"}
    view = PanelView(console, PanelState(state, 20.0), "demo")
    view.start()
    for event in _EVENTS:
        view.take(event)
    view.stop()
    view.stop()
    shown = file.getvalue()
    assert "surgeon: warning: [red]late" in shown
    assert "waiting for the [b]patient" in shown
    assert "received 7" in shown
    assert ("demo  5 of 20 s" in shown) == terminal
    assert ("netem (10.0.0.1): ready" in shown) == (not terminal)
