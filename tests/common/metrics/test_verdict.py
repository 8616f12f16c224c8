"""Requirements met, missed or open; the oracle of every bound is scipy's exact test of a share."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binomtest

from tis.common.metrics.verdict import (
    UNKNOWN,
    Judgement,
    combined,
    judge_loss,
    judge_percentile,
    judge_rms,
    min_packets,
)


def spread(n_failed: int, n: int) -> np.ndarray:
    """Failures as far apart as they can be, so that nothing inflates their variance."""
    failed = np.zeros(n, dtype=np.bool_)
    failed[np.linspace(0, n - 1, n_failed).astype(int)] = True
    return failed


def test_99_percent_needs_299_packets_and_five_nines_of_ten_needs_thirty_million() -> None:
    assert judge_percentile(np.full(298, 1.0), 99, 2.0) == Judgement(
        "not_decidable", 1.0, None, 298, 0, 299, "too_few"
    )
    assert judge_percentile(np.full(299, 1.0), 99, 2.0).outcome == "met"
    short = judge_loss(np.zeros(600, dtype=np.bool_), 1e-5)
    assert (short.outcome, short.value, short.n_needed) == ("not_decidable", 0.0, 29_957_322)


@pytest.mark.parametrize("one_in", [2, 10, 100, 1000])
def test_the_rule_of_three_is_exact(one_in: int) -> None:
    kept, n = 1 - Fraction(1, one_in), min_packets(1 / one_in)
    assert kept**n <= Fraction(5, 100) < kept ** (n - 1)


@settings(deadline=None, max_examples=40)
@given(st.integers(1, 400), st.data(), st.sampled_from([0.5, 2.0, 10.0]))
def test_what_is_decided_is_what_the_exact_test_says(n: int, data: st.DataObject, limit_pct: float) -> None:
    n_lost = data.draw(st.integers(0, n))
    lost = np.zeros(n, dtype=np.bool_)
    lost[:n_lost] = True
    found, p = judge_loss(lost, limit_pct), limit_pct / 100
    missed = binomtest(n_lost, n, p, alternative="greater").pvalue < 0.05
    assert (found.outcome == "missed") == missed
    assert found.excess == (pytest.approx(100 * n_lost / n - limit_pct) if missed else None)
    if found.outcome == "met":  # runs only make it harder
        assert binomtest(n_lost, n, p, alternative="less").pvalue < 0.05


def test_losses_in_one_run_do_not_show_that_few_are_lost_but_those_apart_do() -> None:
    assert judge_loss(spread(10, 1000), 2.0).outcome == "met"
    run = np.zeros(1000, dtype=np.bool_)
    run[300:310] = True
    found = judge_loss(run, 2.0)
    assert (found.outcome, found.obstacle, found.n_outside) == ("not_decidable", "too_few", 10)
    assert found.n_needed is not None
    assert found.n_needed > 1000


def test_an_outage_counts_in_full_against_a_requirement() -> None:
    late = np.ones(600)
    late[200:300] = 50.0
    found = judge_percentile(late, 99, 2.0)
    assert (found.outcome, found.value, found.excess, found.n_outside) == ("missed", 50.0, 48.0, 100)


def test_the_clocks_leave_open_what_they_straddle_and_nothing_else() -> None:
    values = np.full(1000, 10.05)
    assert judge_percentile(values, 99, 10.0).outcome == "missed"
    open_ = judge_percentile(values, 99, 10.0, 0.08)
    assert (open_.outcome, open_.obstacle, open_.excess, open_.n_needed) == ("not_decidable", "clock", None, None)
    assert judge_percentile(values, 99, 9.9, 0.08).outcome == "missed"
    assert judge_percentile(values, 99, 10.2, 0.08).outcome == "met"
    assert judge_percentile(values, 99, 10.0, np.linspace(0, 0.04, 1000)).outcome == "missed"
    assert judge_percentile(values, 99, 10.0, np.inf).obstacle == "clock"


def test_no_loss_at_all_is_a_statement_about_this_run() -> None:
    assert judge_loss(np.zeros(3, dtype=np.bool_), 0.0).outcome == "met"
    assert judge_loss(np.array([False, True, False]), 0.0).outcome == "missed"


def test_a_share_at_the_very_limit_cannot_be_decided_by_any_number() -> None:
    found = judge_loss(spread(30, 600), 5.0)
    assert (found.outcome, found.value, found.n_needed) == ("not_decidable", 5.0, None)


def test_nothing_measured_is_unknown() -> None:
    assert judge_percentile(np.empty(0), 99, 1.0) == UNKNOWN == judge_loss(np.empty(0, dtype=np.bool_), 1.0)
    assert judge_rms(np.empty(0), 1.0) == UNKNOWN


def test_an_error_far_from_its_limit_is_decided_one_near_it_is_not() -> None:
    errors = np.abs(np.random.default_rng(1).normal(size=900))
    rms = float(np.sqrt(np.mean(errors**2)))
    assert judge_rms(errors, 2.0).outcome == "met"
    missed = judge_rms(errors, 0.5)
    assert missed.outcome == "missed"
    assert missed.excess == pytest.approx(rms - 0.5)
    near = judge_rms(errors, 1.005 * rms)
    assert near.outcome == "not_decidable"
    assert near.n_needed is not None
    assert near.n_needed > 900
    assert judge_rms(errors[:20], 9.0).n_needed == 30


def test_correlated_errors_are_wrongly_judged_met_in_one_of_twenty_runs_at_most() -> None:
    """At the very limit; taken as independent, more than a quarter of the runs would be."""
    generator = np.random.default_rng(7)
    n_met = 0
    for _ in range(200):
        noise = generator.normal(size=3000)
        walk = np.empty(3000)
        walk[0] = noise[0]
        for i in range(1, 3000):
            walk[i] = 0.9 * walk[i - 1] + np.sqrt(1 - 0.81) * noise[i]
        n_met += judge_rms(np.abs(walk), 1.0).outcome == "met"
    assert n_met <= 24  # 5 % of 200, and what chance and batches of finite length add
    assert n_met >= 2


def test_of_several_requirements_the_worst_counts() -> None:
    assert combined(["met", "not_decidable", "missed"]) == "missed"
    assert combined(["met", "not_decidable"]) == "not_decidable"
    assert combined(["met", "met"]) == "met"
    assert combined([]) == "not_decidable"
