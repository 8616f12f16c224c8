"""What the page says."""

import re
from typing import get_args

from tis.common.channels import Side
from tis.common.scenario.control import DirectionState, EmulatorState
from tis.common.scenario.network.conditions import Change, TimelineEntry
from tis.common.scenario.network.pipeline import Pipeline
from tis.deploy.view.page import network_html
from tis.deploy.view.page_text import (
    MODES_IN_WORDS,
    PageContext,
    RunOutput,
    figures_html,
    run_html,
    run_text,
    state_html,
    vantage_text,
)
from tis.deploy.watch.live_figures import CrossingFigures, LiveFigures
from tis.deploy.watch.observer import Attendance, Vantage
from tis.deploy.watch.safety import Stretch

ALL: frozenset[Side] = frozenset(get_args(Side))
BESIDE = PageContext(True, "tcp/127.0.0.1:1", "tcp/127.0.0.1:2")
ATTACHED = BESIDE._replace(beside=False)


def _plain(html: str) -> str:
    return " ".join(re.sub(r"<[^>]*>", " ", html).split())


def test_it_says_how_the_run_stands() -> None:
    assert run_text(Attendance(), 0, BESIDE) == "The run is being started; this takes a few seconds."
    waiting = "Waiting for a run whose netem listens at tcp/127.0.0.1:1 (west) and tcp/127.0.0.1:2 (east)."
    assert run_text(Attendance(), 0, ATTACHED) == waiting
    assert run_text(Attendance(True, frozenset({"netem"})), 0, BESIDE) == "Waiting for surgeon and patient."
    assert run_text(Attendance(True, ALL), 0, BESIDE) == "All three are ready; it begins."
    assert run_text(Attendance(True, ALL), 12.4, BESIDE) == "Running, 12 s"
    over = Attendance(True, frozenset(), ALL, "patient left")
    assert run_text(over, 12.4, BESIDE) == "The run has ended after 12.4 s: patient left."


def test_it_says_what_the_patient_has_evidence_of() -> None:
    html = run_html(Attendance(True, ALL), 12.4, BESIDE, alarms={"conflict": 3_240_000_000})
    assert 'role="alert"' in html
    assert "The patient receives samples of the surgeon in two versions" in _plain(html)
    assert "since 3.2 s" in _plain(html)


def test_before_the_end_it_names_no_report_and_what_is_told_is_no_markup() -> None:
    there = Attendance(True, frozenset({"netem", "surgeon"}), frozenset({"patient"}))
    assert "report" not in _plain(run_html(there, 3, BESIDE))
    assert "<script>" not in run_html(Attendance(True, frozenset(), ALL, "<script>"), 3, BESIDE)


def test_when_it_has_ended_it_says_where_the_run_lies() -> None:
    over = Attendance(True, frozenset(), ALL)
    assert "Its report is being written." in _plain(run_html(over, 3, BESIDE))
    assert "Its summary is being written." in _plain(run_html(over, 3, BESIDE._replace(is_reported=False)))
    assert "Its report lies where the run was started" in _plain(run_html(over, 3, ATTACHED))
    told = run_html(over, 3, BESIDE, RunOutput("report", "/runs/<a>/report.html"))
    assert "Its report: /runs/&lt;a&gt;/report.html" in _plain(told)
    assert _plain(told).count("has ended") == 1


def test_figures_have_units_and_what_is_not_known_has_none() -> None:
    crossings = {"arm": CrossingFigures(200, 3, 40.123), "answers": CrossingFigures(200, 0, 39.9)}
    found = LiveFigures(crossings, 69.4, 97.2, 0.448, 0.86)  # type: ignore[arg-type]
    text = _plain(figures_html(found, {"patient": 2}, "<svg>PICTURE</svg>"))
    for part in ("69.4 ms", "97.2 ms", "0.45 mm", "0.86 mm", "52 %", "patient 2: ticks", "PICTURE"):
        assert part in text
    assert "52 %" not in _plain(figures_html(found, {"patient": 2}, is_hold=True))
    assert "None" not in _plain(figures_html(LiveFigures(), {}))


def test_each_figure_names_its_statistic_and_latency_what_it_is_measured_between() -> None:
    crossings = {"arm": CrossingFigures(200, 3, 40.123), "answers": CrossingFigures(200, 0, 39.9)}
    text = _plain(figures_html(LiveFigures(crossings, 3.4, 4.2, 0.448, 0.86), {}))  # type: ignore[arg-type]
    for part in ("median, from a new sample", "99 of 100 within 4.20 ms (p99)", "root mean square (RMSE)"):
        assert part in text
    assert "so it can be below the one-way delay" in text


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
    assert "Now, to the patient: outage, nothing passes changed while running until 5.5 s" in text
    assert "Now, back: delay 40 ms; jitter none; loss 1.5 %, each message by itself changed while running" in text
    assert "not known yet" in state_html(None)


def test_it_names_a_queue_and_what_else_there_is_beside_the_delay() -> None:
    cross = {"kind": "on_off", "kbit_s": 3600, "mean_on_s": 4, "mean_off_s": 8}
    way = _state(False)
    now = way.now.model_validate(
        {"delay": {"kind": "constant", "delay_ms": 10}, "rate": {"kbit_s": 3000, "cross": cross},
         "duplicate": {"p_duplicate": 0.1}}
    )  # fmt: skip
    state = EmulatorState(running=True, forward=way.model_copy(update={"now": now, "stall": True}), feedback=way)
    text = _plain(state_html(state))
    assert (
        "stall, nothing leaves; delay 10 ms; jitter none; loss none; duplicate 10 %; a queue at 3 Mbit/s, shared"
        in text
    )
    assert "3.6 Mbit/s of others, on and off" in text


def test_it_says_how_far_delays_can_be_off_where_that_is_another_host() -> None:
    assert vantage_text(None, ATTACHED) == vantage_text(Vantage(False, 3), BESIDE) == ""
    here, there = (_plain(vantage_text(Vantage(on_it, 12.34), ATTACHED)) for on_it in (True, False))
    assert here.startswith("Delays are seen on netem's own host.")
    assert "off by up to 12.3 ms" in there
    for text in (here, there):
        assert "drift apart, by up to 0.1 ms a second" in text
    assert "off by up to 12.3 ms" in _plain(figures_html(LiveFigures(), {}, there))


FOUND = LiveFigures({"arm": CrossingFigures(200, 3, 40.123), "answers": CrossingFigures(200, 40, 39.9)})


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


def test_where_nothing_arrives_a_tile_says_since_when() -> None:
    text = _plain(figures_html(LiveFigures(silent_s=5.81, display_silent_s=4.0), {}))
    assert "End to end – nothing arrived for 5.8 s" in text
    assert "The operator sees – nothing arrived for 4.0 s" in text


def test_the_tile_of_the_safety_state_explains_each_state() -> None:
    meaning = _plain(figures_html(LiveFigures(), {}, safety={"PSM2": [Stretch("tracking", 0.0, 1.0)]}))
    explained = meaning.rpartition("Safety state following ")[2]
    assert all(word in explained for word in MODES_IN_WORDS.values())
