"""The run's result in few lines: from hand-made summaries, counted."""

import copy
from typing import Any

import pytest
from rich.text import Text

from tests.deploy.report.partial import summary_of
from tis.common.scenario.limits import REQUIREMENTS
from tis.deploy.report import terminal as module
from tis.deploy.report.terminal import MAX_FAULT_LINES, MAX_LINES


def _statistics(p50: float, p99: float) -> dict[str, float]:
    return {"p50": p50, "p95": p99, "p99": p99, "max": p99}


def _link(loss_pct: float, faithful: bool | None = True) -> dict[str, Any]:
    return {
        "loss_pct": loss_pct,
        "verdict": {"faithful": faithful, "undecided": {}, "violations": [], "warnings": []},
    }


def _verdict(name: Any, outcome: str, limit_ms: float) -> dict[str, Any]:
    finding = {"metric": "end_to_end", "binding": True, "limit": limit_ms}
    return {"name": name, "title": REQUIREMENTS[name].title, "outcome": outcome, "findings": [finding]}


def brief(summary: dict[str, Any], warnings: list[str], width: int) -> Text:
    return module.brief(summary_of(summary), warnings, width)


@pytest.fixture
def summary() -> dict[str, Any]:
    return {
        "uncertainty_ms": {},
        "scenario": "default",
        "mode": "live",
        "exit": 0,
        "source": "synthetic surgeon, left hand",
        "valid": True,
        "problems": [],
        "active_estimator": "innovations_kf",
        "active_orientation": "tangent_ls",
        "orientation_deg": {"left": {"tangent_ls": {"rms": 1.25, "ratio_to_hold": 0.61}}},
        "latency_ms": {
            "surgeon": _statistics(0.2, 0.4),
            "network": _statistics(40.1, 52.0),
            "tick_wait": _statistics(20.3, 33.0),
            "compute": _statistics(0.3, 0.6),
            "end_to_end": _statistics(60.9, 69.4),
        },
        "links": {"forward": _link(1.25), "feedback": _link(0.0)},
        "redundancy": {"copies": 1, "history": 0, "lost": {"samples_pct": None}},
        "accuracy": {
            "hold": {"rmse_3d_mm": 2.0, "ratio_to_hold": 1.0, "n_scored": 508},
            "innovations_kf": {"rmse_3d_mm": 0.5, "ratio_to_hold": 0.25},
            "velocity": {"rmse_3d_mm": 0.75, "ratio_to_hold": 0.375},
        },
        "ticks": {"count": 600, "rate_hz": 30, "missed": 1},
        "surgeon_ticks": {"count": 600, "missed": 2},
        "verdicts": [_verdict("haptics", "missed", 2.0), _verdict("felt_delay", "met", 100.0)],
    }


def test_the_figures_stand_in_their_order(summary: dict[str, Any]) -> None:
    assert brief(summary, [], 80).plain.splitlines() == [
        "default (live, synthetic surgeon, left hand)",
        "This run is a valid measurement.",
        "  end to end    median 60.90 ms, p99 69.40 ms, from a new sample to its estimate",
        "  medians, ms   surgeon 0.200, network 40.10, tick wait 20.30, computing 0.300",
        "  packets lost  1.25 % to the patient, 0 % back",
        "  error         innovations_kf 0.500 mm (RMSE in 3D), 25 % of the 2.00 mm of",
        "                repeating the newest position (hold)",
        "  others, mm    velocity 0.750",
        "  orientation   tangent_ls 1.25 deg (61 % of hold's)",
        "  ticks         600 at 30 Hz, 1 missed, 508 scored; the surgeon missed 2",
        "  network       faithful to the scenario",
        "  met           what people accept",
        "  out of reach  haptics (paper): they allow less than the 33.3 ms between ticks",
    ]


def test_a_requirement_is_out_of_reach_only_if_its_time_is_shorter_than_a_tick(summary: dict[str, Any]) -> None:
    summary["ticks"]["rate_hz"] = 1000
    text = brief(summary, [], 80).plain
    assert "out of reach" not in text
    assert "  missed        haptics (paper)" in text


@pytest.mark.parametrize("n_problems", [1, 2, 9, 40])
def test_however_much_is_wrong_it_stays_brief_and_counts_the_rest(summary: dict[str, Any], n_problems: int) -> None:
    problems = [f"links.forward: trouble {k} " + "of many words that take two lines " * 2 for k in range(n_problems)]
    text = brief(summary | {"valid": False, "problems": problems}, ["a warning"], 80).plain
    lines = text.splitlines()
    assert len(lines) <= MAX_LINES + MAX_FAULT_LINES
    assert max(map(len, lines)) <= 80
    n_shown = text.count("trouble ")
    n_warnings = text.count("warning: ")
    counted = next((int(line.split()[1]) for line in lines if line.startswith("  and ")), 0)
    assert not counted or n_problems > 5
    assert n_shown >= 1
    assert n_shown + n_warnings + counted == n_problems + 1
    assert "  requirements  at 30 Hz: 1 met, 1 out of reach" in text  # their names leave the room


def test_problems_name_the_page_of_the_manual_once(summary: dict[str, Any]) -> None:
    assert "troubleshooting" not in brief(summary, ["a warning"], 80).plain
    text = brief(summary | {"valid": False, "problems": ["one", "another"]}, [], 80).plain
    assert text.count("docs/testbed/troubleshooting.md") == 1


def test_the_first_fault_is_whole_however_little_room_is_left(summary: dict[str, Any]) -> None:
    summary["links"]["feedback"] = _link(3.0, faithful=False)
    problem = "links.feedback: " + "starved, as so many packets left late, " * 6 + "and the host is to blame"
    text = " ".join(brief(summary | {"valid": False, "problems": [problem]}, [], 80).plain.split())
    assert problem in text


def test_directions_that_differ_have_a_line_each_and_the_first_reason(summary: dict[str, Any]) -> None:
    summary["links"]["feedback"] = _link(3.0, faithful=False)
    summary["links"]["feedback"]["verdict"]["violations"] = ["loss: 3 % of 1 %", "lateness"]
    text = brief(summary, [], 90).plain
    assert "  forward       faithful to the scenario" in text
    assert "  feedback      not faithful to the scenario: loss: 3 % of 1 %; 1 more: tis info -v" in text


def test_hands_have_a_line_and_an_unscored_run_says_so(summary: dict[str, Any]) -> None:
    by_hand = {"left": summary["accuracy"], "right": copy.deepcopy(summary["accuracy"])}
    by_hand["right"]["innovations_kf"]["rmse_3d_mm"] = 0.625
    assert "  by hand, mm   left 0.500, right 0.625" in brief(summary | {"accuracy_by_hand": by_hand}, [], 80).plain
    assert "  error         not known: no tick could be scored" in brief(summary | {"accuracy": {}}, [], 80).plain


def test_what_the_clocks_drown_is_no_number(summary: dict[str, Any]) -> None:
    summary["uncertainty_ms"] = {"latency_ms.network": {"p50": 50.0}}
    assert "network ?, tick wait" in brief(summary, [], 80).plain
