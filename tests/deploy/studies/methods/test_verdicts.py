"""Verdicts: the rule of order, and the sentences that figures written by hand lead to."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.deploy.studies.methods.made_up import figures, hold, law, scores
from tis.deploy.studies.methods.claims import CLAIMS, order_of, verdict_of, verdicts
from tis.deploy.studies.methods.measured import Merit, growth_words

MERITS = st.floats(0.01, 100).flatmap(
    lambda value: st.floats(0, 1).map(lambda share: Merit(value, value * (1 - share), value * (1 + share)))
)


@pytest.mark.parametrize(
    ("one", "other", "order"),
    [
        (Merit(1.0), Merit(1.04), "not told apart"),
        (Merit(1.0), Merit(1.2), "better"),
        (Merit(1.2), Merit(1.0), "worse"),
        (Merit(1.0, 0.9, 1.1), Merit(1.2, 1.05, 1.3), "not told apart"),
        (Merit(1.0, 0.9, 1.1), Merit(1.3, 1.2, 1.4), "better"),
        (Merit(1.0, 0.9, 1.1), Merit(1.3), "better"),
    ],
)
def test_less_is_better_where_the_difference_is_clear(one: Merit, other: Merit, order: str) -> None:
    assert order_of(one, other) == order


def test_exponents_near_nought_are_not_told_apart_by_their_ratio() -> None:
    assert order_of(Merit(0.001), Merit(0.04)) == "better"
    assert order_of(Merit(0.001), Merit(0.04), is_exponent=True) == "not told apart"
    assert order_of(Merit(0.9), Merit(2.1), is_exponent=True) == "better"


@given(MERITS, MERITS)
def test_the_order_turns_with_its_sides(one: Merit, other: Merit) -> None:
    turned = {"better": "worse", "worse": "better", "not told apart": "not told apart"}
    assert order_of(other, one) == turned[order_of(one, other)]
    assert order_of(one, one) == "not told apart"


def test_every_row_has_a_merit_of_a_complete_method() -> None:
    found = {feature: claim.merit(figures("moesp_kf")) for feature, claim in CLAIMS.items()}
    assert {feature: None if merit is None else merit.value for feature, merit in found.items()} == {
        "complexity": 1.0,
        "real_time": 8.0,
        "packet_loss": 0.6,
        "adaptability": 1.3,
        "data": 2.0,
        "scalability": 0.5,
        "noise": 0.7,
        "training_time": 9.0,
        "reliability": 4.0,
        "applications": pytest.approx(0.6),
    }
    assert CLAIMS["applications"].merit(figures("moesp_kf")) == pytest.approx((0.6, 0.525, 0.675))


def test_all_trials_count_as_more_than_any_number_that_was_tried() -> None:
    merit = CLAIMS["data"].merit(figures("gpr", enough_trials="all"))
    assert merit == Merit(3.0)


def test_the_papers_order_holds_does_not_hold_or_cannot_be_told() -> None:
    ours = figures("moesp_kf")
    slow = figures("transformer", step={**ours["step"], "p99_us": 300.0})
    fast = figures("gpr", step={**ours["step"], "p99_us": 2.0})
    text = verdict_of(CLAIMS["real_time"], [hold(), ours, slow, fast])
    assert "A step of `moesp_kf` takes 5.00 µs at the median, 8.00 at p99" in text
    assert "its steps keep up with ticks at 120 kHz" in text
    assert "Transformer Models (the paper: Moderate): `transformer` has 300.0 µs, so the paper's order holds." in text
    assert "GPR and DRMF (the paper: Limited): `gpr` has 2.00 µs, so the paper's order does not hold." in text
    assert text.endswith("The smallest of all (p99 of a step) is that of `gpr`, 2.00 µs.")
    same = verdict_of(CLAIMS["real_time"], [ours, figures("drmf")])
    assert "`drmf` has 8.00 µs, which cannot be told apart" in same
    assert same.endswith("is that of `moesp_kf`, 8.00 µs; not told apart from it: `drmf`.")


def test_the_best_of_a_family_stands_for_it() -> None:
    ours = figures("moesp_kf", training_s=9.0)
    text = verdict_of(
        CLAIMS["training_time"], [ours, figures("srlsmf", training_s=50.0), figures("gpr", training_s=20.0)]
    )
    assert "GPR and DRMF (the paper: Considerable): `gpr` has 20.00 s, so the paper's order holds." in text


def test_what_was_not_measured_is_said() -> None:
    assert verdict_of(CLAIMS["noise"], [hold()]) == (
        "The paper: *Excellent*. Of `moesp_kf` this was not measured. Transformer Models (the paper: Moderate): not "
        "measured. GPR and DRMF (the paper: Limited): not measured."
    )


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (law(1.4, 1.2, 1.6), "1.40 (1.20 to 1.60): more than the paper's O(n)"),
        (law(0.7, 0.6, 0.8), "no more than the paper's O(n)"),
        (law(1.0, 0.9, 1.1), "what the paper's O(n) says, within the interval"),
        (law(1.2), "to the power 1.20: more than the paper's O(n)"),
    ],
)
def test_an_exponent_is_judged_by_its_interval(found: dict[str, float], words: str) -> None:
    ours = figures("moesp_kf")
    text = verdict_of(
        CLAIMS["complexity"], [figures("moesp_kf", exponents={**ours["exponents"], "train_rows": found})]
    )
    assert words in text


def test_growth_has_its_words() -> None:
    words = [growth_words(ratio) for ratio in (1.0, 1.1, 1.11, 1.5, 2.0, 3.0, 3.1, 100.0)]
    assert words == ["hardly grows"] * 2 + ["grows somewhat"] * 2 + ["grows much"] * 2 + ["multiplies"] * 2


def test_noise_is_judged_beside_holding_after_either_training() -> None:
    text = verdict_of(CLAIMS["noise"], [figures("moesp_kf")])
    assert "With 5 mm of noise, which its training did not have, the error of `moesp_kf` multiplies (4.00" in text
    assert "worse than holding the newest noisy sample (1.50 of hold's)" in text
    assert "With 5 mm of noise, which its training had as well, the error of `moesp_kf` grows much (2.00" in text
    assert "better than holding the newest noisy sample (0.700 of hold's)" in text


def test_a_method_that_errs_more_than_hold_is_never_the_best_of_all() -> None:
    """A filter that stays where it is suffers from nothing."""
    far = [{"delay_ms": 100.0, **scores(9.0, 8.0, 10.0)}]
    still = figures("paper", accuracy=far, training_s=0.1)
    text = verdict_of(
        CLAIMS["training_time"], [hold(), figures("moesp_kf"), figures("arx_kf", training_s=20.0), still]
    )
    assert text.endswith("The smallest of all (training) is that of `moesp_kf`, 9.00 s.")


def test_a_delay_counts_as_won_where_the_interval_is_below_hold() -> None:
    each = [{"delay_ms": 100.0, **scores(0.9, 0.8, 1.01)}, {"delay_ms": 500.0, **scores(0.8, 0.7, 0.9)}]
    assert "it is better at 1 of 2 delays" in verdict_of(CLAIMS["applications"], [figures("moesp_kf", accuracy=each)])


def test_there_are_sentences_for_every_row() -> None:
    found = verdicts([hold(), figures("moesp_kf"), figures("transformer")])
    assert list(found) == [claim.title for claim in CLAIMS.values()]
    assert all(text.endswith(".") and "None" not in text for text in found.values())


def test_at_1_khz_a_step_must_take_less_than_a_tick() -> None:
    text = verdict_of(CLAIMS["scalability"], [figures("moesp_kf")])
    assert "At 1000 ticks a second a step takes 70.00 µs at p99, less than a tick lasts." in text
    slow = {**scores(0.9), "step_p50_us": 7.0, "step_p99_us": 1001.0}
    assert "1001 µs at p99, more than" in verdict_of(CLAIMS["scalability"], [figures("moesp_kf", fast=slow)])
