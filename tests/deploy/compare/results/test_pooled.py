"""Pooled scores against the arrays they come from, and intervals against a plain loop."""

from typing import Any

import numpy as np
import pytest
from scipy.special import ndtri

from tis.common.metrics.tracking import Scorable, ratio_to_hold, score
from tis.common.streams import Stream
from tis.deploy.compare.results.pooled import (
    ENOUGH_PEOPLE,
    N_RESAMPLES,
    origin,
    pooled,
    range_holds_median_pct,
    resampled,
    rivalries,
)

RANGE_M = np.array([0.05, 0.04, 0.02])


def _normal(label: str, n: int) -> np.ndarray:
    return np.asarray(ndtri(Stream.named(5, label).uniforms(0, 3 * n))).reshape(n, 3)


@pytest.mark.parametrize(
    ("synthetic", "said"), [([], ""), (["S001"], "partly synthetic"), (["S001", "D001"], "synthetic")]
)
def test_the_origin_is_that_of_all_trials(synthetic: list[str], said: str) -> None:
    assert origin({"trials": ["D001", "S001"], "synthetic": synthetic}) == said


class Hand:
    """The truth and two estimates of one hand, in m, and the sums that a cell would keep of it."""

    def __init__(self, label: str, n: int, size: float = 1.0) -> None:
        self.truth = 0.02 * _normal(f"{label}/truth", n) + [1.0, 2.0, 3.0]
        self.hold = self.truth + 4e-3 * size * _normal(f"{label}/hold", n)
        self.better = self.truth + 1e-3 * size * _normal(f"{label}/better", n)

    def sums(self) -> dict[str, Any]:
        centred = self.truth - self.truth.mean(axis=0)
        return {
            "n_scored": len(self.truth),
            "sst_m2": np.sum(centred**2, axis=0).tolist(),
            "range_m": RANGE_M.tolist(),
            "estimators": {
                name: {
                    "sse_m2": np.sum((estimate - self.truth) ** 2, axis=0).tolist(),
                    "n_missing": 0,
                    "n_covered": 9,
                    "n_ellipsoids": 10,
                }
                for name, estimate in (("hold", self.hold), ("better", self.better))
            },
        }


HANDS = [Hand("a", 50), Hand("b", 80, 2.0), Hand("c", 30, 0.5), Hand("d", 60)]


@pytest.mark.parametrize("n_hands", [1, 2])
def test_the_hands_of_a_trial_score_as_their_arrays_do(n_hands: int) -> None:
    hands = HANDS[:n_hands]
    everything = [np.ones(len(hand.truth), dtype=bool) for hand in hands]
    exact = score(
        *(Scorable(h.better, h.hold, h.truth, ticks, RANGE_M) for h, ticks in zip(hands, everything, strict=True))
    )
    found = pooled([[hand.sums() for hand in hands]], "better")
    for name in ("r2_pct", "rmse_mm", "rmse_3d_mm", "rmse_normalized", "ratio_to_hold", "n_scored", "n_missing"):
        assert found[name] == pytest.approx(exact[name], rel=1e-12), name
    assert found["coverage_pct"] == 90
    assert found["ratio_to_hold_interval_95"] is None


def test_pooling_weighs_every_tick_alike_and_keeps_each_hand_s_own_mean() -> None:
    found = pooled([[HANDS[0].sums(), HANDS[1].sums()], [HANDS[2].sums()]], "better")
    three = HANDS[:3]
    errors = [hand.better - hand.truth for hand in three]
    assert found["ratio_to_hold"] == pytest.approx(
        ratio_to_hold(errors, [hand.hold - hand.truth for hand in three]), rel=1e-12
    )
    sse = np.sum(np.concatenate(errors) ** 2, axis=0)
    sst = np.sum([len(hand.truth) * hand.truth.var(axis=0) for hand in three], axis=0)
    assert found["r2_pct"] == pytest.approx(100 * (1 - sse / sst), rel=1e-10)
    assert found["rmse_normalized"] == pytest.approx(np.sqrt(sse / 160) / RANGE_M, rel=1e-10)
    assert (found["n_scored"], found["n_people"]) == (160, 2)


def test_intervals_are_percentiles_over_resampled_people() -> None:
    units = [[hand.sums()] for hand in HANDS]
    ratios = []
    for chosen in resampled(4)[:N_RESAMPLES]:
        sse = sum(float(np.sum((HANDS[i].better - HANDS[i].truth) ** 2)) for i in chosen)
        hold = sum(float(np.sum((HANDS[i].hold - HANDS[i].truth) ** 2)) for i in chosen)
        ratios.append((sse / hold) ** 0.5)
    found = pooled(units, "better")
    assert found["ratio_to_hold_interval_95"] == pytest.approx(np.percentile(ratios, [2.5, 97.5]), rel=1e-10)
    assert found["ratio_to_hold_interval_95"][0] <= found["ratio_to_hold"] <= found["ratio_to_hold_interval_95"][1]
    assert pooled(units, "hold")["ratio_to_hold_interval_95"] == [1.0, 1.0]
    low, high = found["r2_pct_interval_95"][1]
    assert low < found["r2_pct"][1] < high


def test_rivals_are_resampled_together() -> None:
    units = [[hand.sums()] for hand in HANDS]
    own, best = (
        [float(np.sum((getattr(hand, name) - hand.truth) ** 2)) for hand in HANDS] for name in ("hold", "better")
    )
    ratios = [(sum(own[i] for i in chosen) / sum(best[i] for i in chosen)) ** 0.5 for chosen in resampled(4)]
    both = rivalries(units, ["hold", "better"])
    found = both["hold"]
    assert found["ratio_to_best"] == pytest.approx((sum(own) / sum(best)) ** 0.5, rel=1e-12)
    assert found["ratio_to_best_interval_95"] == pytest.approx(np.percentile(ratios, [2.5, 97.5]), rel=1e-10)
    assert both["better"] == {"ratio_to_best": 1.0, "ratio_to_best_interval_95": [1.0, 1.0]}
    assert rivalries(units[:1], ["hold", "better"])["hold"]["ratio_to_best_interval_95"] is None


def test_resamples_draw_every_person_equally_often() -> None:
    counts = np.bincount(resampled(5).ravel(), minlength=5)
    assert counts.sum() == 5 * N_RESAMPLES
    assert np.all(np.abs(counts / N_RESAMPLES - 1) < 0.05)


def test_what_has_no_range_no_movement_or_no_ellipsoid_is_none() -> None:
    still = HANDS[0].sums() | {"sst_m2": [0.0, 1.0, 1.0], "range_m": [0.0, 0.1, 0.1]}
    still["estimators"]["better"]["n_ellipsoids"] = 0
    found = pooled([[still], [still]], "better")
    assert found["r2_pct"][0] is found["rmse_normalized"][0] is found["coverage_pct"] is None
    assert found["r2_pct_interval_95"][0] is found["coverage_pct_interval_95"] is None
    assert found["r2_pct"][1] is not None


@pytest.mark.parametrize("n_people", [2, 3, 4, 6])
def test_the_range_of_few_people_seldom_holds_the_median_of_all(n_people: int) -> None:
    """Against drawn people of a skewed distribution, whose median is 1."""
    n_draws = 20_000
    drawn = np.exp(ndtri(Stream.named(9, "people").uniforms(0, n_draws * n_people))).reshape(n_draws, n_people)
    held_pct = 100 * np.mean((drawn.min(axis=1) <= 1) & (drawn.max(axis=1) >= 1))
    assert range_holds_median_pct(n_people) == pytest.approx(held_pct, abs=1.5)
    assert (range_holds_median_pct(n_people) > 95) == (n_people >= ENOUGH_PEOPLE)


def test_an_interval_lies_within_the_range_of_its_people_s_figures() -> None:
    found = pooled([[hand.sums()] for hand in HANDS[:3]], "better")
    alone = [pooled([[hand.sums()]], "better")["ratio_to_hold"] for hand in HANDS[:3]]
    low, high = found["ratio_to_hold_interval_95"]
    assert min(alone) - 1e-12 <= low <= high <= max(alone) + 1e-12
