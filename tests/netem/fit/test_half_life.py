"""Half-lives of autoregressive paths made by numpy's own generator; a marginal of any shape, gaps, no correlation."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.special import ndtr
from scipy.stats import gamma

from tis.netem.fit.half_life import fit_half_life, gaussian_scores

N = 60_000
NS = 10**9


def path(rate_hz: float, half_life_s: float, seed: int = 1, n: int = N) -> tuple[np.ndarray, np.ndarray]:
    """Return the normal scores of N messages at a steady rate, and when they were sent."""
    rho = 2.0 ** (-1 / (rate_hz * half_life_s))
    steps = np.random.default_rng(seed).normal(size=n)
    steps[1:] *= np.sqrt(1 - rho**2)
    return np.asarray(lfilter([1], [1, -rho], steps)), (np.arange(n) * NS // int(rate_hz)).astype(np.int64)


def delays(z: np.ndarray) -> np.ndarray:
    return np.rint(gamma(2).ppf(ndtr(z)) * 3e6 + 20e6).astype(np.int64)


@pytest.mark.parametrize(("rate_hz", "half_life_s"), [(1000, 0.01), (100, 0.05), (30, 0.02), (100, 1.0)])
def test_the_half_life_is_found(rate_hz: float, half_life_s: float) -> None:
    z, sent_ns = path(rate_hz, half_life_s)
    found = fit_half_life(sent_ns, delays(z))
    assert found.seconds == pytest.approx(half_life_s, rel=0.15)
    assert found.correlated_share == pytest.approx(1, abs=0.06)


@pytest.mark.parametrize(("rate_hz", "half_life_s"), [(30, 0.01), (100, 0.004)])
def test_below_a_few_message_intervals_none_can_be_resolved(rate_hz: float, half_life_s: float) -> None:
    z, sent_ns = path(rate_hz, half_life_s)
    found = fit_half_life(sent_ns, delays(z))
    assert found.seconds is None
    assert f"less than 0.5 message intervals of {1000 / rate_hz:.3g} ms: cannot be resolved" in found.why


def test_its_interval_covers_it_as_often_as_it_says() -> None:
    covered = 0
    for seed in range(60):
        z, sent_ns = path(100, 0.05, seed, n=4000)
        interval = fit_half_life(sent_ns, delays(z)).interval
        assert interval is not None
        covered += interval[0] <= 0.05 <= interval[1]
    assert covered >= 51  # 57 expected of 95 %; the jackknife of a ratio is a little narrow


def test_gaps_and_uneven_sampling_change_nothing_much() -> None:
    z, sent_ns = path(100, 0.05)
    kept = np.random.default_rng(2).random(N) < 0.4
    assert fit_half_life(sent_ns[kept], delays(z)[kept]).seconds == pytest.approx(0.05, rel=0.1)


def test_independent_delays_have_none() -> None:
    z, sent_ns = path(100, 0.05)
    shuffled = np.random.default_rng(3).permutation(z)
    found = fit_half_life(sent_ns, delays(shuffled))
    assert (found.seconds, found.why) == (None, "indistinguishable from independent delays")


def test_independent_delays_are_rarely_taken_for_correlated() -> None:
    sent_ns = np.arange(2000) * NS // 100
    rng = np.random.default_rng(4)
    found = [fit_half_life(sent_ns, rng.integers(1, 10**8, 2000)).seconds is not None for _ in range(200)]
    assert sum(found) <= 3  # 0.2 expected at 1 in 1000


def test_alternating_delays_have_none() -> None:
    sent_ns = np.arange(2000) * NS // 100
    found = fit_half_life(sent_ns, np.where(np.arange(2000) % 2, 10**6, 2 * 10**6))
    assert (found.seconds, found.why) == (None, "neighbours differ more than independent delays would")


def test_noise_on_top_shows_as_a_share() -> None:
    z, sent_ns = path(100, 0.5)
    noise = np.random.default_rng(5).normal(size=N)
    found = fit_half_life(sent_ns, delays(np.sqrt(0.6) * z + np.sqrt(0.4) * noise))
    assert found.correlated_share == pytest.approx(0.6, abs=0.06)


@pytest.mark.parametrize(
    ("delay_ns", "why"),
    [([10**6] * 500, "all delays are equal"), ([1, 2] * 50, "100 messages arrived, it takes 150")],
)
def test_too_little_to_tell(delay_ns: list[int], why: str) -> None:
    assert fit_half_life(np.arange(len(delay_ns)) * NS, np.array(delay_ns)).why == why


@pytest.mark.parametrize(("half_life_s", "is_found"), [(None, False), (0.1, True)])
def test_200_pings_of_which_a_few_are_lost_suffice(half_life_s: float | None, is_found: bool) -> None:
    kept = np.random.default_rng(1).random(N) > 0.05
    z, sent_ns = path(100, half_life_s or 1e-9)
    found = [
        fit_half_life(sent_ns[part][kept[part]], delays(z[part][kept[part]])).seconds
        for part in (slice(k, k + 200) for k in range(0, 6000, 200))
    ]
    n_found = sum(one is not None for one in found)
    assert n_found >= 27 if is_found else n_found <= 1
    assert not is_found or 0.03 < float(np.median([one for one in found if one is not None])) < 0.2


def test_scores_of_ties_are_equal_and_symmetric() -> None:
    scores = gaussian_scores(np.array([7, 7, 3, 9]))
    assert scores[0] == scores[1]
    assert scores[2] == pytest.approx(-scores[3])
