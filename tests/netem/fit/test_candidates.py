"""Records of other processes: the structure that each asks for is taken, and its replays close.

The full version, at 600 s and 100 replays, is ``python -m tests.netem.fit.bench_closure``.
"""

from dataclasses import replace

import numpy as np
import pytest

from tests.netem.fit.synthetic_records import Parameters, record
from tis.common.scenario.network import NetworkPart
from tis.common.trace import Trace
from tis.netem.fit.candidates import fit_closing
from tis.netem.fit.direction import DirectionFit
from tis.netem.fit.record import MEASURING_ADDS, DirectionRecord

_FAR = 2.0
SHORT = Parameters(seconds=150, rate_hz=50, p_loss=0.03, good=8, cycle=8, stall=0.3, stall_spread=0, gap=25)


def closing(name: str) -> DirectionFit:
    fit = fit_closing(DirectionRecord.of(record(name, SHORT, seed=2)), n=12)
    network = NetworkPart.model_validate(fit.network("forward", "feedback"))
    assert network.forward == network.feedback
    return fit


@pytest.mark.parametrize(
    ("name", "n_outages", "kind"),
    [("bursts", 0, None), ("outages", 1, None), ("bad_states", 0, "markov"), ("stalls", 0, None)],
)
def test_each_record_gets_the_structure_it_asks_for(name: str, n_outages: int, kind: str | None) -> None:
    fit = closing(name)
    assert (len(fit.outages.lengths_s) > 0) == (n_outages > 0)
    assert (fit.states.kind if fit.states else None) == kind
    assert (fit.stalls is not None) == (name == "stalls")
    assert fit.n_replays == 12
    # 12 replays say little about their middle 95 %: nothing may lie more than twice as far out
    assert not [one for one in fit.closures if one.severity > _FAR]


def test_what_measuring_added_is_no_state_and_no_stall() -> None:
    """A constant delay beside a machine with slow stretches: a relay that did nothing had as much."""
    rng = np.random.default_rng(5)
    sent_ns = np.arange(3000) * 10_000_000
    slow = np.repeat(np.arange(400) % 2, rng.geometric(0.03, 400))[:3000] == 1
    delay_ms = 30 + rng.gamma(2, 0.2, 3000) + slow * rng.gamma(2, 6, 3000)
    about = {MEASURING_ADDS: "21.271 (p95 - p5), 68.3 (max - min)"}
    arrived_ns = np.maximum.accumulate(sent_ns + np.rint(delay_ms * 1e6).astype(np.int64))
    trace = Trace("t", sent_ns, arrived_ns - sent_ns, about)
    fit = fit_closing(DirectionRecord.of(trace), n=12)
    assert fit.steady
    assert (fit.states, fit.stalls, fit.backlogs, fit.steps) == (None, None, None, None)
    assert set(fit.stages) == {"delay"}
    assert fit_closing(DirectionRecord.of(replace(trace, about={})), n=0).stages["delay"]["kind"] != "constant"


def test_without_replays_nothing_is_compared_and_one_regime_is_taken() -> None:
    fit = fit_closing(DirectionRecord.of(record("bad_states", SHORT, seed=2)), n=0)
    assert (fit.closures, fit.states, fit.n_replays) == ((), None, 0)
    assert fit.stages["loss"]["kind"] == "gilbert_elliott"
    assert fit.stages["loss"]["p_loss_bad"] == pytest.approx(0.5, abs=0.1)


def test_a_record_that_no_structure_closes_is_named() -> None:
    """A delay that grows from 10 to 100 ms through the whole record: its autocorrelation stays near 1."""
    sent_ns = np.arange(6000) * 10_000_000
    noise_ms = np.random.default_rng(1).gamma(2, 1, 6000)
    delay_ns = np.rint((10 + sent_ns / 6e10 * 90 + noise_ms) * 1e6).astype(np.int64)
    fit = fit_closing(DirectionRecord.of(Trace("t", sent_ns, delay_ns)), n=12)
    assert "autocorrelation at 10 s" in {one.name for one in fit.closures if not one.closes}


def test_a_slow_part_of_each_period_is_a_cycle_and_no_stall() -> None:
    """Every 8 s, 2 s with 30 ms more and a tenth lost: nothing waits for anything."""
    rng = np.random.default_rng(3)
    sent_ns = np.arange(7500) * 20_000_000
    slow = sent_ns / 1e9 % 8 < 2
    delay_ms = 15 + rng.gamma(4, 0.5, 7500) + 30 * slow
    lost = rng.random(7500) < 0.1 * slow
    fit = fit_closing(
        DirectionRecord.of(Trace("t", sent_ns, np.where(lost, -1, np.rint(delay_ms * 1e6)).astype(int))), n=12
    )
    assert fit.states is not None
    assert fit.states.kind == "cycle"
    assert (fit.stalls, fit.backlogs) == (None, None)
    assert sum(state.duration["for_s"] for state in fit.states.states) == pytest.approx(8, abs=0.05)
