"""Share and mean run of the losses against the models' own laws, with N from the models' own variances."""

from itertools import islice
from math import ceil

import numpy as np
import pytest
from scipy import stats

from tests.netem.stages.loss.making import big_chain, losses, make, netfi
from tis.common.metrics.loss import loss_runs
from tis.common.scenario.network import loss as network
from tis.common.streams import BLOCK
from tis.netem.stages.loss import ExpectedLoss, expected_loss

BOUND = 0.02  # four standard errors, relative
NETFI = {
    "netfi_plm_1": netfi((4.428, 1.638), (4.966, 0.271)),
    "netfi_plm_2": netfi((4.604, 3.552), (3.901, 1.466)),
    "netfi_plm_3": netfi((3.859, 3.324), (3.797, 6.049)),
}
CHAINS = {
    "bernoulli": make("bernoulli", p_loss=0.01),
    "burst": make("burst", p_loss=0.01, mean_burst=3),
    "gilbert_elliott": make("gilbert_elliott", p_bad=0.003, p_good=0.3, p_loss_bad=0.9, p_loss_good=0.0012),
    "gilbert_elliott_swapping": make("gilbert_elliott", p_bad=0.9, p_good=0.7),
    "four_state": make("four_state", p13=0.002, p31=0.5, p32=0.2, p23=0.5, p14=0.0062),
    "gilbert_pareto": make(
        "gilbert_pareto", p_bad=0.05, p_good=0.2, good={"shape": 5, "scale": 0.5}, bad={"shape": 5, "scale": 1.1}
    ),
    **NETFI,
}
PARETO_RUNS = make("pareto_runs", received={"shape": 4, "scale": 450}, lost={"shape": 4.5, "scale": 2})


def check(part: network.Loss, want: ExpectedLoss, std_loss: float, std_burst: float) -> None:
    """``std``: of one packet's contribution; over N packets the standard error is std / sqrt(N)."""
    n_needed = max((4 * std_loss / (BOUND * want.p_loss)) ** 2, (4 * std_burst / (BOUND * want.mean_burst)) ** 2)
    n_blocks = ceil(n_needed / BLOCK)
    runs = loss_runs(losses(part, n_blocks))
    got = f"N = {runs.n}: p_loss {runs.n_lost / runs.n:.6f}, mean burst {runs.mean_burst:.5f}, want {want}"
    print(part.kind, got)  # noqa: T201 - N is part of the statement
    assert runs.mean_burst is not None
    assert abs(runs.n_lost / runs.n - want.p_loss) <= 4 * std_loss / np.sqrt(runs.n), got
    assert abs(runs.mean_burst - want.mean_burst) <= 4 * std_burst / np.sqrt(runs.n), got


@pytest.mark.parametrize("name", CHAINS)
def test_loss_and_mean_burst_are_within_four_standard_errors_of_at_most_2_percent(name: str) -> None:
    chain = big_chain(CHAINS[name])
    check(CHAINS[name], expected_loss(CHAINS[name], {}), chain.std_of_mean(chain.lost), chain.std_of_burst())


def test_so_they_are_for_heavy_tailed_runs() -> None:
    assert isinstance(PARETO_RUNS, network.ParetoRunsLoss)
    k = np.arange(10**6)
    moments = []
    for law in (PARETO_RUNS.received, PARETO_RUNS.lost):
        longer = (1 + k / law.scale) ** -law.shape  # P(run > k)
        mean = longer.sum()
        moments.append((mean, ((2 * k + 1) * longer).sum() - mean**2))
    (received, var_received), (lost, var_lost) = moments
    both = received + lost
    # alternating renewal process: the variance of the time spent in one phase (Cox, "Renewal theory")
    std_loss = np.sqrt((received**2 * var_lost + lost**2 * var_received) / both**3)
    check(PARETO_RUNS, ExpectedLoss(lost / both, lost), std_loss, np.sqrt(var_lost * both))


@pytest.mark.parametrize("name", CHAINS)
def test_run_lengths_follow_the_models_law(name: str) -> None:
    lengths = loss_runs(losses(CHAINS[name], 250)).lengths[1:-1]
    law = big_chain(CHAINS[name]).run_law(40)
    assert_follows(lengths, law)


def test_mean_burst_alone_makes_geometric_runs() -> None:
    lengths = loss_runs(losses(make("burst", p_loss=0.2, mean_burst=8), 250)).lengths[1:-1]
    assert_follows(lengths, stats.geom(1 / 8).pmf(np.arange(1, 60)))


@pytest.mark.parametrize("of_lost", [True, False])
def test_heavy_tailed_runs_follow_lomax_both_ways(of_lost: bool) -> None:
    part = make("pareto_runs", received={"shape": 3, "scale": 20}, lost={"shape": 2.5, "scale": 6})
    lost = losses(part, 250)
    lengths = loss_runs(lost if of_lost else ~lost).lengths[1:-1]
    law = stats.lomax(2.5, scale=6) if of_lost else stats.lomax(3, scale=20)
    assert_follows(lengths, np.diff(law.cdf(np.arange(200))))


def assert_follows(lengths: "np.typing.NDArray[np.int64]", law: "np.typing.NDArray[np.float64]") -> None:
    """Chi-square over classes 1, 2, .. of at least 20 expected runs, the rest in the last one."""
    n_classes = sum(1 for _ in islice((p for p in law if p * len(lengths) >= 20), len(law)))
    observed = np.bincount(np.minimum(lengths, n_classes + 1), minlength=n_classes + 2)[1:]
    wanted = np.append(law[:n_classes], 1 - law[:n_classes].sum()) * len(lengths)
    if wanted[-1] < 5:  # too few for a class of their own
        observed = np.append(observed[:-2], observed[-2:].sum())
        wanted = np.append(wanted[:-2], wanted[-2:].sum())
    if len(wanted) == 1:
        assert observed[0] == len(lengths)
        return
    assert stats.chisquare(observed, wanted).pvalue > 0.001


def test_netfi_profiles_lose_what_was_measured_of_the_original() -> None:
    shares = [round(100 * expected_loss(part, {}).p_loss, 1) for part in NETFI.values()]
    assert shares == pytest.approx([9.8, 30.4, 50.3], abs=0.11)
