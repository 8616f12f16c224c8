"""State of the panel from literal events."""

import io
from typing import Any

import pytest
from rich.console import Console

from tis.deploy.hosts.panel import PanelState, PanelView

PLACES: Any = {"surgeon": "10.0.0.2", "netem": "10.0.0.1", "patient": "namespace p"}


def _event(side: str, event: str, **more: Any) -> dict[str, Any]:
    return {"side": side, "event": event} | more


def test_each_side_shows_for_whom_it_waits_and_how_far_it_is() -> None:
    panel = PanelState(PLACES, 20.0)
    assert panel.take(_event("patient", "waiting", whom="netem")) == ["patient (namespace p): waiting for netem"]
    assert panel.take(_event("patient", "waiting", whom="netem")) == []
    panel.take(_event("patient", "ready"))
    assert not panel.has_begun
    panel.take(_event("patient", "running", duration_s=20.0))
    assert panel.has_begun
    counters = {"received": 7, "estimates": 5, "ticks_missed": 0, "other": 3}
    assert panel.take(_event("patient", "progress", now_s=1.2, counters=counters)) == [
        "   1/20 s  received 7  estimates 5  ticks missed 0"
    ]
    assert panel.take(_event("patient", "progress", now_s=6.1, counters=counters)) == []
    assert panel.sides["patient"].state == "running at 6 of 20 s"
    assert len(panel.take(_event("patient", "progress", now_s=6.3, counters=counters))) == 1
    assert panel.now_s == 6.3
    panel.take(_event("patient", "progress", now_s=20.9, counters=counters))
    assert panel.now_s == 20.0
    assert panel.sides["patient"].state == "running at 20 of 20 s"
    assert panel.sides["surgeon"].state == "starting"
    panel.take(_event("netem", "progress", now_s=1.0, counters={"forward.dropped.loss": 2, "feedback.dropped": 1}))
    assert panel.counts("netem") == "lost 2 there, 1 back"


def test_a_failure_says_its_reasons_once_and_an_exit_code_only_where_there_are_none() -> None:
    panel = PanelState(PLACES, 20.0)
    assert panel.take(_event("netem", "failed", reasons=["in use", "again"])) == [
        "netem (10.0.0.1): failed: in use; again"
    ]
    assert panel.take(_event("netem", "exit", code=3)) == []
    assert panel.take(_event("surgeon", "ended", counters={})) == ["surgeon (10.0.0.2): ended"]
    assert panel.take(_event("surgeon", "exit", code=0)) == []
    assert panel.take(_event("patient", "exit", code=-9)) == ["patient (namespace p): killed by signal 9"]
    assert panel.take(_event("patient", "restarted", n=1, code=-9)) == [
        "patient (namespace p): died, started again (1)"
    ]
    assert panel.take(_event("patient", "exit", code=4)) == ["patient (namespace p): failed with exit code 4"]


def test_a_run_goes_on_while_netem_lives_and_nobody_has_ended() -> None:
    panel = PanelState(PLACES, 20.0)
    panel.take(_event("netem", "ready"))
    assert not panel.goes_on("patient"), "it has not begun"
    panel.take(_event("netem", "running", duration_s=20.0))
    panel.take(_event("patient", "exit", code=-9))
    assert panel.goes_on("patient")
    panel.take(_event("netem", "exit", code=-9))
    assert not panel.goes_on("patient")
    assert panel.goes_on("netem")
    panel.take(_event("netem", "restarted", n=1, code=-9))
    assert panel.goes_on("patient")
    panel.take(_event("surgeon", "ended", counters={}))
    assert not panel.goes_on("patient")


def test_the_last_warnings_stay_in_the_panel() -> None:
    panel = PanelState(PLACES, 20.0)
    for n in range(7):
        assert panel.take(_event("surgeon", "warning", warning=f"w{n}")) == [f"surgeon: warning: w{n}"]
    found = panel.take(_event("netem", "warning", warning="got round", kind="bypass"))
    assert found == ["netem: warning (bypass): got round"]
    panel.warnings.pop()
    assert panel.take(_event("netem", "output", text="Traceback")) == ["netem: Traceback"]
    assert list(panel.warnings) == [*(f"surgeon: warning: w{n}" for n in range(3, 7)), "netem: Traceback"]
    assert panel.take(_event("patient", "gone", text="connection lost")) == [
        "patient (namespace p): gone: connection lost"
    ]


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


def test_a_side_that_was_told_to_end_has_not_failed() -> None:
    panel = PanelState(PLACES, 20.0)
    panel.take(_event("netem", "running", duration_s=20.0))
    panel.take(_event("netem", "ending"))
    assert panel.take(_event("netem", "failed", exit_code=130, reasons=["interrupted at 3.0 s"])) == [
        "netem (10.0.0.1): ended"
    ]
    assert panel.take(_event("netem", "exit", code=130)) == []
    assert (panel.sides["netem"].state, panel.sides["netem"].kind) == ("ended", "ended")
