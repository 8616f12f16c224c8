"""How what a probe found is printed when the clocks are two."""

import io

import numpy as np
import pytest
from rich.console import Console

from tis.common.clocks import SHARED, ClockModel, Exchanges, fit_clock
from tis.common.trace import Trace, parse_trace, render_trace
from tis.deploy.net.ends import Ends
from tis.deploy.net.probe import Paired, Plan, Probed
from tis.deploy.net.probe_command import comparison, delay_uncertainties, path_figures, print_path, trace_of
from tis.netem.fit.record import Spread

MS = 1_000_000
ONE = Exchanges.of([(0, 5_000 * MS, 5_001 * MS, 9 * MS)])
"""One exchange that took 8 ms on the way: the far end is 4996 +- 4 ms ahead."""


def _probed(doubt_ms: int, clock: ClockModel) -> Probed:
    sent_ns = np.arange(4, dtype=np.int64) * MS
    delay_ns = np.array([2 * MS, 4 * MS, -1, 6 * MS], dtype=np.int64)
    return Probed(sent_ns, Paired(delay_ns, np.full(4, doubt_ms * MS)), 0, 0, clock, ONE)


def _printed(probed: Probed) -> str:
    out = Console(file=io.StringIO(), width=300)
    print_path(path_figures(Trace("t", probed.sent_ns, probed.paired.delay_ns)), out, probed)
    assert isinstance(out.file, io.StringIO)
    return out.file.getvalue()


def test_figures_carry_their_uncertainty_and_those_below_it_say_nothing() -> None:
    said = _printed(_probed(5, fit_clock(ONE)))
    assert "mean 4 ± 5 (not resolvable), std 1.633, p50 4 ± 5 (not resolvable)" in said
    assert "max 6 ± 5\n" in said


def test_one_clock_leaves_no_doubt() -> None:
    assert "±" not in _printed(_probed(0, SHARED))


def test_what_the_machine_adds_comes_back_from_the_trace() -> None:
    plan = Plan("k", 100.0, 4, 64, 5.0, 10.0)
    adds = Spread(40_000, 50_000, 900_000)
    found = trace_of(_probed(0, SHARED), "t", Ends("tcp/a:1", "tcp/b:1"), plan, "now", adds)
    again = parse_trace(render_trace(found), "t.csv")
    assert again.about["measuring_adds_ms"] == "0.040000 (p95 - p5), 0.900000 (max - min)"
    assert again.about == found.about
    without = trace_of(_probed(0, SHARED), "t", Ends("tcp/a:1", "tcp/b:1"), plan, "now")
    assert "measuring_adds_ms" not in without.about


def test_every_figure_but_the_deviation_has_an_uncertainty() -> None:
    doubts = delay_uncertainties(_probed(1, fit_clock(ONE)))
    assert set(doubts) == {"mean", "p50", "p90", "p95", "p99", "p99.9", "max"}
    assert doubts["p50"] == pytest.approx(1)


def test_the_header_says_how_the_clocks_were_compared() -> None:
    about = comparison(_probed(5, fit_clock(ONE)))
    assert about["clock"].startswith("compared by 1 exchanges over the same path, shortest round trip 8 ms")
    assert about["clock_offset"] == "far end ahead by 4996.000000 ms at the first exchange"
    assert about["uncertainty"] == "± 5 ms at most, a bound"
    assert comparison(_probed(0, SHARED))["clock"].startswith("shared")


def test_the_uncertainty_is_a_column_that_reading_ignores() -> None:
    trace = Trace("t", np.array([0, MS]), np.array([2 * MS, -1]), {"clock": "two"})
    text = render_trace(trace, np.array([500_000, 500_001]))
    assert text == "# clock: two\nsent_s,delay_ms,uncertainty_ms\n0,2,0.5\n0.001,,0.500001\n"
    assert parse_trace(text, "t").delay_ns.tolist() == [2 * MS, -1]
