"""The fit and its intervals on streams whose law is known, drawn here state by state."""

from math import inf

import numpy as np
import pytest
from numpy.typing import NDArray

from tis.common.metrics.gilbert_fit import fit_gilbert, loss_interval
from tis.common.metrics.loss import wilson_interval


def gilbert(n: int, p: float, r: float, seed: int, loss_bad: float = 1.0) -> NDArray[np.bool_]:
    """A stream by its run lengths, which are geometric; begun in equilibrium, since they have no memory."""
    rng = np.random.default_rng(seed)
    n_runs = 2 * int(n * p * r / (p + r) + 10 * np.sqrt(n) + 10)
    lengths = np.stack([rng.geometric(p, n_runs), rng.geometric(r, n_runs)], axis=1).ravel()
    states = np.tile([False, True], n_runs)
    if rng.random() < p / (p + r):
        lengths, states = lengths[1:], states[1:]
    bad = np.repeat(states, lengths)[:n]
    assert len(bad) == n
    return bad & (rng.random(n) < loss_bad)


def test_a_known_chain_is_found_again() -> None:
    fit = fit_gilbert(gilbert(2_000_000, 0.01, 0.2, seed=1))
    assert fit.p_bad == pytest.approx(0.01, rel=0.03)
    assert fit.p_good == pytest.approx(0.2, rel=0.03)
    assert fit.mean_burst == pytest.approx(5.0, rel=0.03)
    assert fit.p_loss == pytest.approx(0.01 / 0.21, rel=0.03)
    assert fit.mean_burst is not None
    assert fit.mean_burst_interval is not None
    assert fit.mean_burst_interval[0] < fit.mean_burst < fit.mean_burst_interval[1]
    assert fit.p_loss_interval[0] < fit.p_loss < fit.p_loss_interval[1]


def test_by_hand() -> None:
    # steps: o>o o>x x>x x>o o>x x>o
    fit = fit_gilbert(np.array([0, 0, 1, 1, 0, 1, 0], dtype=bool))
    assert (fit.p_loss, fit.p_bad, fit.p_good, fit.mean_burst) == (3 / 7, 2 / 3, 2 / 3, 1.5)


def test_a_run_that_the_record_cuts_is_not_a_short_one() -> None:
    cut = np.array([0, 0, 1, 1, 1, 0, 1], dtype=bool)
    assert fit_gilbert(cut).mean_burst == 3.0  # 3 lost packets with a successor, one end


def test_what_was_not_seen_is_not_known() -> None:
    none = fit_gilbert(np.zeros(50, dtype=bool))
    assert (none.p_loss, none.p_bad, none.p_good, none.mean_burst, none.mean_burst_interval) == (
        0,
        0,
        None,
        None,
        None,
    )
    assert none.p_loss_interval == wilson_interval(0, 50)
    endless = fit_gilbert(np.ones(50, dtype=bool))
    assert (endless.p_loss, endless.p_bad, endless.p_good, endless.mean_burst) == (1, None, 0, None)
    assert endless.mean_burst_interval is not None
    assert endless.mean_burst_interval[1] == inf
    assert fit_gilbert(np.array([True])).mean_burst_interval is None


def test_nothing_cannot_be_fitted() -> None:
    for function in (fit_gilbert, loss_interval):
        with pytest.raises(ValueError, match="at least one packet"):
            function(np.zeros(0, dtype=bool))


def test_independent_losses_have_nearly_wilsons_interval() -> None:
    lost = np.random.default_rng(3).random(40_000) < 0.03
    low, high = loss_interval(lost)
    plain = wilson_interval(int(lost.sum()), len(lost))
    assert plain is not None
    assert 1.0 <= (high - low) / (plain[1] - plain[0]) < 1.35


def test_losses_that_repel_each_other_do_not_narrow_it() -> None:
    lost = np.arange(300) % 2 == 0
    assert loss_interval(lost) == wilson_interval(150, 300)


@pytest.mark.parametrize(
    ("p", "r", "loss_bad"),
    [(0.02, 0.98, 1.0), (0.0132, 0.25, 1.0), (0.002, 0.1, 1.0), (0.01, 0.1, 0.5)],
    ids=["independent", "bursts of 4", "bursts of 10", "bad loses half"],
)
def test_the_intervals_hold_the_truth_as_often_as_they_say(p: float, r: float, loss_bad: float) -> None:
    n_streams = 300
    streams = [gilbert(12_000, p, r, seed, loss_bad) for seed in range(n_streams)]
    share = p / (p + r) * loss_bad
    held = sum(low <= share <= high for low, high in map(loss_interval, streams)) / n_streams
    # 0.95 plus and minus 4 standard errors of 300 streams; too wide would be 1
    assert 0.90 <= held < 1.0
    if loss_bad == 1.0:
        fits = [fit_gilbert(lost) for lost in streams]
        inside = [
            fit.mean_burst_interval is not None and fit.mean_burst_interval[0] <= 1 / r <= fit.mean_burst_interval[1]
            for fit in fits
        ]
        assert 0.90 <= sum(inside) / n_streams < 1.0


def test_wilsons_interval_alone_would_not() -> None:
    streams = [gilbert(12_000, 0.0132, 0.25, seed) for seed in range(300)]
    plain = [wilson_interval(int(lost.sum()), len(lost)) for lost in streams]
    held = sum(interval is not None and interval[0] <= 0.0132 / 0.2632 <= interval[1] for interval in plain)
    assert held / 300 < 0.8
