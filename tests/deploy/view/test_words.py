"""What the page says."""

import re
from typing import get_args

from common.channels import Side
from common.scenario.control import DirectionState, EmulatorState
from common.scenario.network.conditions import Change, TimelineEntry
from common.scenario.network.pipeline import Pipeline
from deploy.view.words import figures_html, run_text, sides_html, state_html
from deploy.watch.figures import CrossingFigures, LiveFigures
from deploy.watch.observer import Attendance

ALL: frozenset[Side] = frozenset(get_args(Side))


def _plain(html: str) -> str:
    return " ".join(re.sub(r"<[^>]*>", " ", html).split())


def test_it_says_how_the_run_stands() -> None:
    assert run_text(Attendance(), 0) == "Looking for netem …"
    assert run_text(Attendance(True, frozenset({"netem"})), 0) == "Waiting for surgeon and patient …"
    assert run_text(Attendance(True, ALL), 0) == "All three are ready; it begins."
    assert run_text(Attendance(True, ALL), 12.4) == "Running, 12 s"
    over = Attendance(True, frozenset(), ALL, "patient left")
    assert run_text(over, 12.4).startswith("The run is over, at 12.4 s: patient left.")


def test_it_says_who_is_there_and_what_is_told_is_no_markup() -> None:
    there = Attendance(True, frozenset({"netem", "surgeon"}), frozenset({"patient"}))
    text = _plain(sides_html(there, 3))
    assert "surgeon running" in text
    assert "patient has left" in text
    assert "<script>" not in sides_html(Attendance(True, frozenset(), ALL, "<script>"), 3)


def test_figures_have_units_and_what_is_not_known_has_none() -> None:
    crossings = {"arm": CrossingFigures(200, 3, 40.123, 60.0), "answers": CrossingFigures(200, 0, 39.9, 60.0)}
    found = LiveFigures(crossings, 69.4, 97.2, 68.7, 0.448, 0.86)  # type: ignore[arg-type]
    text = _plain(figures_html(found, 2))
    for part in ("40.1 ms", "back 39.9 ms", "1.50 %", "69.4 ms", "97.2 ms", "0.45 mm", "0.52 &times;", "2 since"):
        assert part.replace(" &times;", "&times;") in text
    assert "None" not in _plain(figures_html(LiveFigures(), 0))


def _state(outage: bool, *added: TimelineEntry) -> DirectionState:
    pipeline = Pipeline.model_validate(
        {"delay": {"kind": "constant", "delay_ms": 40}, "loss": {"kind": "bernoulli", "p_loss": 0.015}}
    )
    return DirectionState(
        outage=outage, scale_delay=1, add_delay_ms=0, add_p_loss=0, pipeline=pipeline, now=pipeline, rules=(),
        added=added, counters={},
    )  # fmt: skip


def test_it_says_what_netem_does_and_until_when() -> None:
    entry = TimelineEntry(at_s=3, for_s=2.5, direction="forward", set=Change(outage=True))
    lasting = TimelineEntry(at_s=3, direction="feedback", set=Change(add_delay_ms=5))
    state = EmulatorState(running=True, forward=_state(True, entry), feedback=_state(False, lasting))
    text = _plain(state_html(state))
    assert "to the patient constant 40 ms none outage until 5.5 s" in text
    assert "back constant 40 ms none bernoulli 1.5 % yes" in text
    assert "not said yet" in state_html(None)
