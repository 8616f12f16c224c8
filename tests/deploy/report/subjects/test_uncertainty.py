import io
import re
from copy import deepcopy
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from rich.console import Console

from tests.common.clocks.wrong_clock import WrongClock
from tests.deploy.hold_only import HOLD
from tests.deploy.report.other_hosts import MONOTONIC_NS, as_run, run_apart
from tests.deploy.report.partial import summary_of
from tis.common.channels import Side
from tis.common.metrics.percentiles import summarise
from tis.common.records import ESTIMATES, TRUTH
from tis.common.units import NS_PER_MS
from tis.deploy.logs.read.load import aligned
from tis.deploy.logs.read.side_log import MemoryLog
from tis.deploy.report.answer import answer
from tis.deploy.report.subjects.age import ages_of_hand
from tis.deploy.report.subjects.clocks import not_resolvable
from tis.deploy.report.subjects.tracking import track_of_hand
from tis.deploy.report.summarise import build_summary
from tis.deploy.report.terminal import print_summary
from tis.deploy.run.resolve import resolve
from tis.patient_side.statespace import ArmModel

DELAY_MS = 20.0
CLOCKS: dict[Side, WrongClock] = {"surgeon": WrongClock(400_000, 50.0), "patient": WrongClock(-900_000, -35.0)}
Apart = tuple[dict[Side, MemoryLog], tuple[ArmModel, ...]]
APART: dict[Side, str] = {"surgeon": "host a", "patient": "host b"}


def _scenario(*more: str) -> Any:
    constant = f"{{kind: constant, delay_ms: {DELAY_MS:g}}}"
    settings = [f"network.{direction}.delay={constant}" for direction in ("forward", "feedback")]
    settings += [f"network.{direction}.jitter=null" for direction in ("forward", "feedback")]
    return resolve("default", [*settings, *more, *HOLD], 1, 6.0)


@pytest.fixture(scope="module")
def apart() -> Apart:
    """The logs of a run of the scenario with both sides on hosts of their own, and its models; not to be changed."""
    return run_apart(_scenario(), CLOCKS, APART)


def test_one_way_figures_of_hosts_apart_come_back_within_their_uncertainty(apart: Apart) -> None:
    """In virtual time each message takes 20 ms exactly; by the sides' own clocks it does not.

    Exchanges take 100 us and more, four fifths of it on the way there.
    """
    scenario = _scenario()
    logs, models = apart
    summary, raw = (
        build_summary(run, scenario, models, "live", 0, "") for run in (aligned(as_run(logs)), as_run(logs))
    )
    bounds = summary["uncertainty_ms"]["latency_ms.network"]
    for name, bound in bounds.items():
        assert 0 < bound < 0.3, name
        assert abs(summary["latency_ms"]["network"][name] - DELAY_MS) <= bound, name
        assert abs(raw["latency_ms"]["network"][name] - DELAY_MS) > 3 * bound, name
    assert raw["uncertainty_ms"] == {}  # nobody has compared anything: as if it were a twin
    assert summary["not_resolvable"] == []
    clocks = summary["clocks"]
    for side, clock in CLOCKS.items():
        assert clocks[side]["kind"] == "exchanged"
        assert clocks[side]["drift_ppm"] == pytest.approx(clock.drift_ppm, abs=clocks[side]["drift_uncertainty_ppm"])
        ahead_ms = (MONOTONIC_NS + clock.offset_ns) / NS_PER_MS
        # at run time 0 by the side's own clock, whose stamps the drift stretches
        assert clocks[side]["offset_ms"] == pytest.approx(ahead_ms + clock.offset_ns / NS_PER_MS, abs=0.5)
    assert re.fullmatch(r"20\.\d\d \u00b1 0\.\d\d ms", summary_of(summary).text("latency_ms.network", "p50", " ms"))
    assert re.search(r"\+ network \(sent to received\) +(20\.\d\d +|19\.\d\d +){4}0\.\d\d\n", _seen(summary))


def _seen(summary: dict[str, Any]) -> str:
    out = io.StringIO()
    print_summary(summary_of(summary), Console(file=out, width=120), verbose=True)
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines()) + "\n"


def test_ages_come_back_within_their_uncertainty(apart: Apart) -> None:
    """The age at each tick by both clocks' true errors, against that by the aligned logs."""
    scenario = _scenario()
    logs, models = apart
    summary = build_summary(aligned(as_run(logs)), scenario, models, "live", 0, "")
    at_ns, age_ns = ages_of_hand(as_run(logs), "left")
    true_ms = (_true_ns(CLOCKS["patient"], at_ns) - _true_ns(CLOCKS["surgeon"], at_ns - age_ns)) / NS_PER_MS
    bounds = summary["uncertainty_ms"]
    for name, right in summarise(true_ms).items():
        assert right is not None
        assert abs(summary["age_ms"][name] - right) <= bounds["age_ms"][name] < 0.3
    worst_ms = max(bounds["age_ms"].values())
    assert worst_ms <= bounds["age_of_information_ms"]["mean"] < 1.2 * worst_ms
    # a sample's age on arrival is its delay: 20 ms, or what the surgeon's side took beside
    on_arrival = summary["tick_modes"]["on_arrival"]["age_when_used_ms"]
    assert abs(on_arrival["p50"] - DELAY_MS) <= bounds["tick_modes.on_arrival.age_when_used_ms"]["p50"]


def test_delay_variation_is_as_uncertain_as_both_delays_that_it_is_the_difference_of(apart: Apart) -> None:
    """Each message takes 20 ms exactly, so there is none; what the clocks' drift adds lies within what is said."""
    scenario = _scenario()
    logs, models = apart
    summary = build_summary(aligned(as_run(logs)), scenario, models, "live", 0, "")
    findings = [finding for verdict in summary["verdicts"] for finding in verdict["findings"]]
    varied = [finding for finding in findings if finding["title"].startswith("delay variation")]
    assert {finding["title"].partition(", ")[2] for finding in varied} == {"forward", "feedback"}
    for finding in varied:
        assert 0 < finding["value"] <= finding["uncertainty"] < 0.6


def test_the_truth_is_aligned_too() -> None:
    """Where the arm really was at each tick, by both clocks' true errors, which are 12 ms apart."""
    scenario = _scenario("source.recorder_hz=51.33")
    wrong: dict[Side, WrongClock] = {"surgeon": WrongClock(6_000_000, 50.0), "patient": WrongClock(-6_000_000, -35.0)}
    logs, _ = run_apart(scenario, wrong, APART)
    rows, ticks = logs["surgeon"].log.of(TRUTH), logs["patient"].log.of(f"{ESTIMATES}/hold")
    sample_ns = _true_ns(wrong["surgeon"], [row["sample_ns"] for row in rows])
    t_ns = _true_ns(wrong["patient"], [row["t_ns"] for row in ticks])
    x_m = np.array([row["position_m"]["x"] for row in rows])
    inside = (t_ns > sample_ns[0]) & (t_ns < sample_ns[-1])
    truth_m = np.interp(t_ns, sample_ns, x_m)

    found, raw = (track_of_hand(run, scenario, "left").truth_m[:, 0] for run in (aligned(as_run(logs)), as_run(logs)))
    assert inside.sum() > 100
    assert np.abs(found - truth_m)[inside].max() < 20e-6
    assert np.abs(raw - truth_m)[inside].max() > 500e-6


def _true_ns(clock: WrongClock, own_ns: Any) -> NDArray[np.float64]:
    return np.array(own_ns) * (1 + clock.drift_ppm * 1e-6) + clock.offset_ns


def test_two_sides_on_one_host_know_their_latencies_exactly() -> None:
    scenario = _scenario()
    clock = WrongClock(400_000, 50.0)
    logs, models = run_apart(scenario, {"surgeon": clock, "patient": clock}, {"surgeon": "one", "patient": "one"})
    summary = build_summary(aligned(as_run(logs)), scenario, models, "live", 0, "")
    assert summary["clocks"]["surgeon"]["kind"] == "exchanged"
    assert set(summary["uncertainty_ms"]["latency_ms.network"].values()) == {0}
    # by the hosts' clock 20 ms last 1 us less; the fit knows the drift to some ppm
    assert summary["latency_ms"]["network"]["p50"] == pytest.approx(DELAY_MS, abs=1e-3)
    assert summary_of(summary).text("latency_ms.network", "p50") == "20.00"


def test_a_figure_that_the_clocks_drown_is_not_resolvable() -> None:
    """Exchanges over 50 ms ways leave 25 ms open: 20 ms of delay are not resolvable, 36 end to end neither."""
    scenario = _scenario()
    logs, models = run_apart(scenario, CLOCKS, APART, way_ns=50_000_000)
    summary = build_summary(aligned(as_run(logs)), scenario, models, "live", 0, "")
    assert "latency_ms.network.p50" in summary["not_resolvable"]
    assert summary_of(summary).text("latency_ms.network", "p50", " ms") == "not resolvable"
    assert summary["latency_ms"]["network"]["p50"] is not None
    seen = _seen(summary)
    says = "the latency of the estimates is not resolvable, the clocks are uncertain by \u00b1 "
    assert says in " ".join(seen.split())
    assert re.search(r"\+ network \(sent to received\) +\? +\? +\? +\? +\d", seen)
    assert "The latency of the estimates is not resolvable, the clocks are uncertain by" in answer(
        summary_of(summary), scenario
    )
    assert summary["latency_ms"]["round_trip"]["p50"] == pytest.approx(56, abs=3)  # one clock: known as ever


def test_figures_of_a_clock_that_nobody_compared_are_open(apart: Apart, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = _scenario()
    logs, models = apart
    monkeypatch.delitem(logs["surgeon"].log.rows, "/tis/clock_exchanges")
    summary = build_summary(aligned(as_run(logs)), scenario, models, "live", 0, "")
    assert summary["clocks"]["surgeon"]["kind"] == "unknown"
    assert set(summary["uncertainty_ms"]["latency_ms.network"].values()) == {None}


def test_how_a_figure_reads() -> None:
    summary: dict[str, Any] = {"latency_ms": {"network": {"p50": 12.414, "p99": 0.05, "max": None}}}
    bounds = {"latency_ms.network": {"p50": 0.08, "p99": 0.08, "max": None}}
    whole = deepcopy(summary) | {"uncertainty_ms": bounds}
    assert summary_of(whole).text("latency_ms.network", "p50", " ms") == "12.41 \u00b1 0.08 ms"
    assert summary_of(whole).text("latency_ms.network", "p99", " ms") == "not resolvable"
    assert summary_of(whole).text("latency_ms.network", "max") == "-"
    assert summary_of(summary).text("latency_ms.network", "p50") == "12.41"
    assert not_resolvable({"latency_ms.network": summary["latency_ms"]["network"]}, bounds) == [
        "latency_ms.network.p99"
    ]
