"""The page of a netem that runs by itself, from literal answers."""

import pytest

from tis.common.scenario.control import DirectionState, EmulatorState, RecentDelays
from tis.common.scenario.network.pipeline import Pipeline
from tis.deploy.view.netem_alone import GONE_S, NetemAlone, Passing, passing


def _state(at_s: float, offered: int, lost: int = 0, delays: RecentDelays | None = None) -> EmulatorState:
    pipeline = Pipeline.model_validate({"delay": {"kind": "constant", "delay_ms": 20}, "rate": {"kbit_s": 900}})
    way = DirectionState(
        outage=False, scale_delay=1, add_delay_ms=0, add_p_loss=0, pipeline=pipeline, now=pipeline, rules=(),
        added=(), counters={"offered": offered, "dropped.loss": lost, "dropped.outage": lost}, delays=delays,
    )  # fmt: skip
    return EmulatorState(running=True, standalone=True, at_s=at_s, forward=way, feedback=way)


def test_what_passes_is_what_the_counts_have_grown_by() -> None:
    assert passing(_state(10, 100, 5), _state(14, 300, 15), "forward") == Passing(50.0, 10.0)
    assert passing(_state(10, 100), _state(14, 100), "forward") == Passing(0.0, None)
    assert passing(_state(10, 100), _state(10, 100), "forward") is None


def test_figures_are_of_the_last_seconds_and_the_network_is_shown_whole() -> None:
    alone = NetemAlone()
    assert not alone.is_there
    for second in range(20):  # 10 a second, then 100 a second
        n = 10 * min(second, 10) + 100 * max(0, second - 10)
        alone.take(_state(second, n, 0, RecentDelays(within_s=5, n=500, p50_ms=20.06, p99_ms=31.4)), second)
    assert alone.is_there
    figures = alone.figures_html()
    for part in ("forward (west to east): offered", "100 /s", "0 %", "20.06 ms", "p99 31.40 ms", "of 500 that left"):
        assert part in figures
    state = alone.state_html()
    assert "constant" in state
    assert "900" in state
    assert "19 s" in alone.words()


def test_a_netem_of_a_run_is_not_alone() -> None:
    alone = NetemAlone()
    alone.take(_state(3, 1).model_copy(update={"standalone": False}), 3)
    alone.take(None, 10)
    assert (alone.is_there, alone.is_over) == (False, False)


@pytest.mark.parametrize("answer", [None, _state(1, 10)])
def test_it_is_over_when_no_new_answer_comes(answer: EmulatorState | None) -> None:
    alone = NetemAlone()
    alone.take(_state(1, 10), 100.0)
    alone.take(answer, 100.0 + GONE_S)
    assert not alone.is_over
    alone.take(answer, 100.5 + GONE_S)
    assert alone.is_over
    assert "does not answer" in alone.words()


def test_one_that_is_started_anew_begins_anew() -> None:
    alone = NetemAlone()
    alone.take(_state(50, 1000), 0)
    alone.take(_state(1, 10), 1)
    alone.take(_state(2, 30), 2)
    assert "20 /s" in alone.figures_html()
