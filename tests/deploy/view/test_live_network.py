"""The network on the live page: who is there, and how both directions are."""

import re

from tis.common.scenario.control import DirectionState, EmulatorState
from tis.common.scenario.network.pipeline import Pipeline
from tis.deploy.view.page import network_html
from tis.deploy.view.page_text import PageContext
from tis.deploy.watch.live_figures import CrossingFigures, LiveFigures
from tis.deploy.watch.observer import Attendance

BESIDE = PageContext(True, "tcp/127.0.0.1:1", "tcp/127.0.0.1:2")
FOUND = LiveFigures({"arm": CrossingFigures(200, 3, 40.123), "answers": CrossingFigures(200, 40, 39.9)})


def _plain(html: str) -> str:
    return " ".join(re.sub(r"<[^>]*>", " ", html).split())


def _state(outage: bool) -> DirectionState:
    pipeline = Pipeline()
    return DirectionState(
        outage=outage, scale_delay=1, add_delay_ms=0, add_p_loss=0, pipeline=pipeline, now=pipeline, rules=(),
        added=(), counters={},
    )  # fmt: skip


def test_it_says_who_is_there() -> None:
    there = Attendance(True, frozenset({"netem", "surgeon"}), frozenset({"patient"}))
    text = _plain(network_html(there, 3, BESIDE, LiveFigures(), None))
    for part in ("surgeon running", "netem running", "patient has left"):
        assert part in text
    starting = _plain(network_html(Attendance(), 0, BESIDE, LiveFigures(), None))
    assert starting.count("starting") == 3
    assert starting.count("not known") == 2


def test_it_says_how_both_directions_are_and_netem_names_outages() -> None:
    text = _plain(network_html(Attendance(), 3, BESIDE, FOUND, None))
    assert "to the patient: good , median 40.1 ms, 1.5 % lost" in text
    assert "back: suffering , median 39.9 ms, 20 % lost" in text
    silent = EmulatorState(running=True, forward=_state(True), feedback=_state(False))
    text = _plain(network_html(Attendance(), 3, BESIDE, FOUND, silent))
    assert "to the patient: outage , median" in text
    assert "back: suffering" in text
