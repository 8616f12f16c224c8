"""The answer in words, for figures chosen by hand."""

from typing import Any

import pytest

from tests.deploy.report.hand_made import a_scenario
from tests.deploy.report.partial import summary_of
from tis.common.scenario import Scenario
from tis.deploy.report import answer as module


def answer(summary: dict[str, Any], scenario: Scenario) -> str:
    return module.answer(summary_of(summary), scenario)


def _entry(rmse_3d_mm: float | None, ratio: float | None) -> dict[str, Any]:
    return {"rmse_3d_mm": None if rmse_3d_mm is None else float(rmse_3d_mm), "ratio_to_hold": ratio}


def _summary(
    accuracy: dict[str, Any],
    loss: tuple[float | None, float | None] = (1.5, 0.0),
    copies: int = 1,
    history: int = 0,
    samples_pct: float | None = 1.5,
) -> dict[str, Any]:
    return {
        "age_ms": {"p50": 60.0, "p95": 90.0, "p99": 100.0, "max": 110.0},
        "latency_ms": {"end_to_end": {"p50": 68.71, "p99": 102.04}},
        "links": {"forward": {"loss_pct": loss[0]}, "feedback": {"loss_pct": loss[1]}},
        "accuracy": accuracy,
        "display": {"left": None},
        "redundancy": _sent(copies, history, samples_pct),
    }


def _sent(copies: int, history: int, samples_pct: float | None) -> dict[str, Any]:
    return {
        "copies": copies,
        "copy_spacing_ms": 8.0,
        "history": history,
        "lost": {"samples_pct": samples_pct},
    }


SCORES = {"hold": _entry(2, 1), "innovations_kf": _entry(0.5, 0.25), "plant": _entry(0.1, 0.05)}


def test_it_says_how_late_how_lossy_and_how_accurate() -> None:
    assert answer(_summary(SCORES), a_scenario()) == (
        "An estimate with a new sample is published when that is 68.71 ms old in the median, and at "
        "most 102.0 ms in 99 of 100 cases (p99). The network lost 1.50 % of the packets from surgeon to patient and "
        "none of those back. The patient's estimator, innovations_kf, was off the arm's true position by 0.500 mm "
        "(RMSE in 3D); merely repeating the newest arm position that arrived (hold) was off by 2.00 mm. So "
        "estimating leaves 25 % of the error."
    )


def test_where_nothing_new_comes_for_long_the_age_at_all_ticks_is_told() -> None:
    old = _summary(SCORES) | {"age_ms": {"p50": 70.0, "p95": 150.0, "p99": 235.0, "max": 369.0}}
    expected = (
        "At all ticks, also those without a new one, the newest is at most 235.0 ms old (p99), 369.0 ms at worst."
    )
    assert expected in answer(old, a_scenario())


def test_a_run_with_touch_leads_with_the_verdict_on_its_loop() -> None:
    spread = {"rms": 0.1, "p50": 0.1, "p95": 0.2, "max": 0.3}
    touch = {
        "stability": "unstable", "stable": False, "stiffness_n_m": 1500.0, "limit_n_m": 194.0,
        "shown_over_true": None, "energy_mj": 2.1, "force_error_n": spread, "force_beyond_n": spread,
        "force_delay_ms": spread, "round_trip_ms": spread, "drift_mm": None, "peak_force_n": 4.1,
        "force_packets": {"sent": 10, "suppressed": 5}, "motion_packets": {"sent": 15, "suppressed": 0},
    }  # fmt: skip
    text = answer(_summary(SCORES) | {"touch": {"left": touch}}, a_scenario())
    first = text.partition(".")[0]
    assert "unstable" in first
    assert "1500 N/m" in first
    assert text.endswith(answer(_summary(SCORES), a_scenario()))


@pytest.mark.parametrize(
    ("static", "loss_pct", "is_told"), [(True, 20.0, True), (False, 20.0, False), (True, 0.0, False)]
)
def test_the_gain_of_the_second_packet_is_told_where_some_are_lost(
    static: bool, loss_pct: float, is_told: bool
) -> None:
    summary = _summary(SCORES, (loss_pct, 0.0)) | {"identification": {"static": static}}
    assert ("part of that gain is the second packet's" in answer(summary, a_scenario())) is is_told
    worse = summary | {"accuracy": {"hold": _entry(2, 1), "innovations_kf": _entry(3, 1.5)}}
    assert "second packet" not in answer(worse, a_scenario())  # there is no gain


def test_another_estimator_that_is_better_is_named() -> None:
    scores = SCORES | {"static_gain": _entry(0.4, 0.2)}
    assert "static_gain came closest, with 0.400 mm." in answer(_summary(scores), a_scenario())
    worse = {"hold": _entry(2, 1), "innovations_kf": _entry(3, 1.5)}
    text = answer(_summary(worse), a_scenario())
    assert "So estimating did not pay here: it leaves 150 % of the error. Of all estimators hold came closest" in text


def test_two_hands_are_told_apart() -> None:
    right = {"hold": _entry(4, 1), "innovations_kf": _entry(3, 0.75), "static_gain": _entry(1, 0.25)}
    summary = _summary(SCORES) | {"accuracy_by_hand": {"left": SCORES, "right": right}}
    text = answer(summary, a_scenario(source={"kind": "synthetic", "hands": ["left", "right"]}))
    assert "by 0.500 mm (left hand) and 3.00 mm (right hand) (RMSE in 3D); " in text
    assert "by 2.00 mm (left hand) and 4.00 mm (right hand)." in text
    assert "leaves 25 % and 75 % of the error." in text
    assert "static_gain came closest, with 1.00 mm, right hand." in text


def test_hold_may_be_the_one_that_acts() -> None:
    scenario = a_scenario(active_estimator="hold", estimators=["hold"])
    assert (
        "hold, which repeats the newest arm position that arrived, was off the arm by 2.00 mm (RMSE in 3D)."
        in answer(_summary(SCORES), scenario)
    )


UNSCORED = _entry(None, None) | {"n_scored": 0, "n_missing": 0}


@pytest.mark.parametrize("accuracy", [{}, {"hold": UNSCORED, "innovations_kf": UNSCORED}])
def test_what_is_not_known_is_said_to_be_unknown(accuracy: dict[str, Any]) -> None:
    summary = _summary(accuracy, (None, None))
    summary["latency_ms"]["end_to_end"] = {"p50": None, "p99": None}
    assert answer(summary, a_scenario()) == (
        "How late the estimates were is not known. How much was lost is not known. "
        "How accurate the estimates were is not known."
    )


@pytest.mark.parametrize(
    ("copies", "history", "samples_pct", "words"),
    [
        (4, 2, 0.0, "each sample 4 times, 8 ms apart, with the 2 samples before it: every sample arrived. The"),
        (1, 1, 0.02, "each sample once, with the sample before it: 0.02 % of the samples never arrived. The"),
    ],
)
def test_packets_lost_are_told_apart_from_samples_that_never_arrived(
    copies: int, history: int, samples_pct: float, words: str
) -> None:
    text = answer(_summary(SCORES, (1.5, 0.0), copies, history, samples_pct), a_scenario())
    assert (
        f"lost 1.50 % of the packets from surgeon to patient and none of those back. The surgeon sent {words}" in text
    )


def test_who_sends_once_or_knows_nothing_says_nothing_of_samples() -> None:
    assert "samples" not in answer(_summary(SCORES), a_scenario())
    assert "samples" not in answer(_summary(SCORES, (None, None), 4, 0, None), a_scenario())
