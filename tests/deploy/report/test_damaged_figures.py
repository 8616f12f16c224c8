"""What a summary says of a run whose logs have holes: figures of what is known, against the same run when whole."""

from dataclasses import replace
from pathlib import Path
from shutil import copytree
from typing import Any

import numpy as np
import pytest

from tests.deploy.logs.conftest import run_dir, scenario
from tests.deploy.report.hand_made import ARM, COMMAND, ONE_CLOCK, a_scenario, estimate, message, truth, write_run
from tests.deploy.report.partial import causes
from tis.common.scenario import Scenario
from tis.deploy.logs.coverage import FOREVER, WRITTEN_WITHIN_NS, Coverage, Span
from tis.deploy.logs.read.load import RunLogs, load_run, models_in
from tis.deploy.report import load
from tis.deploy.report.subjects.age import age_of_information_ms, ages_of_hand, freshest_arrivals
from tis.deploy.report.subjects.tracking import track_of_hand
from tis.deploy.report.summarise import build_summary

__all__ = ["run_dir", "scenario"]

S = 1_000_000_000


def _holed(logs: RunLogs, side: str, *unknown: Span) -> RunLogs:
    log = logs.sides[side]  # type: ignore[index]
    return replace(logs, sides={**logs.sides, side: replace(log, coverage=Coverage("x", None, "torn", unknown))})  # type: ignore[dict-item]


def _summary(logs: RunLogs, scenario: Scenario) -> dict[str, Any]:
    return build_summary(logs, scenario, models_in(logs), "twin", 0, "")


def test_accuracy_of_a_cut_run_is_that_of_the_ticks_it_still_has(
    run_dir: Path, scenario: Scenario, tmp_path: Path
) -> None:
    path = Path(copytree(run_dir, tmp_path / "cut"))
    whole = (path / "patient.mcap").read_bytes()
    (path / "patient.mcap").write_bytes(whole[: len(whole) * 19 // 20])
    logs = load_run(path)
    summary, run = _summary(logs, scenario), load(run_dir)
    ((until_ns, end),) = logs.sides["patient"].coverage.unknown
    assert end == FOREVER
    track = run.tracks["left"]
    kept = track.scored & (track.t_ns <= until_ns)
    assert 0 < kept.sum() < track.scored.sum()
    for name in ("hold", "moesp_kf"):
        entry = summary["accuracy_by_hand"]["left"][name]
        # the tick at the very end may be noted and its estimate not
        assert kept.sum() - 2 <= entry["n_scored"] <= kept.sum()
        last = np.flatnonzero(kept)[: entry["n_scored"]]
        assert entry["rmse_3d_mm"] == pytest.approx(np.sqrt(np.mean(run.error_mm(name, "left")[last] ** 2)))
    assert [text for text in summary["problems"] if "links" in text] == []
    assert f"ticks: the log tells of {summary['ticks']['count']} of {scenario.n_samples}" in causes(
        summary["problems"]
    )
    assert summary["logs"]["patient"]["state"] == "damaged"
    assert summary["logs"]["patient"]["unknown_s"] == [[until_ns / S, None]]
    for link in summary["links"].values():
        assert (link["unplanned_loss"], link["held_at_end"]) == (0, 0)
        assert link["untold"] > 0


def test_the_truth_is_not_drawn_across_a_hole_of_the_surgeons_log(tmp_path: Path) -> None:
    """The arm went out and back while nobody looked; a line from edge to edge would be wrong by 1 m."""
    patient = [ONE_CLOCK, message(ARM, 0, 0, log_ms=1), *(estimate(k, 100 * k, "hold", (0, 0, 0)) for k in range(50))]
    there = [truth(k, 100 * k, (float(1500 < 100 * k < 3500), 0, 0)) for k in range(50) if not 1400 < 100 * k < 3600]
    logs = write_run(tmp_path, surgeon=there, patient=patient)
    assert np.isfinite(track_of_hand(logs, a_scenario(), "left").truth_m).all()
    track = track_of_hand(_holed(logs, "surgeon", (1_400_000_000, 3_600_000_000)), a_scenario(), "left")
    known = np.isfinite(track.truth_m[:, 0])
    assert track.t_ns[~known].min() == 1_400_000_000
    assert track.t_ns[~known].max() == 3_600_000_000
    assert not track.scored[~known].any()
    assert known.sum() == 50 - 23


def test_ages_beside_a_hole_of_the_patients_log_are_left_out(run_dir: Path) -> None:
    logs = load_run(run_dir)
    due_ns, age_ns = ages_of_hand(logs, "left")
    hole = (2 * S, 3 * S)
    found_ns, found_age_ns = ages_of_hand(_holed(logs, "patient", hole), "left")
    far = (due_ns < hole[0] - WRITTEN_WITHIN_NS) | (due_ns > hole[1] + WRITTEN_WITHIN_NS)
    assert np.array_equal(found_ns, due_ns[far])
    assert np.array_equal(found_age_ns, age_ns[far])


def test_age_over_time_is_unknown_with_a_hole_and_known_up_to_a_cut(run_dir: Path, scenario: Scenario) -> None:
    logs = load_run(run_dir)
    arms = {model.hand: model.arm for model in models_in(logs)}
    arrivals = freshest_arrivals(logs, scenario.session, arms)
    assert age_of_information_ms(_holed(logs, "patient", (S, 2 * S)), arrivals)["mean"] is None
    assert age_of_information_ms(_holed(logs, "patient", (4 * S, FOREVER)), arrivals)["mean"] is not None


def test_how_long_more_would_take_is_not_said_where_the_time_is_not_known(run_dir: Path, scenario: Scenario) -> None:
    logs = load_run(run_dir)
    lines = [verdict["line"] for verdict in _summary(logs, scenario)["verdicts"]]
    assert any("at this rate" in line for line in lines)
    lines = [verdict["line"] for verdict in _summary(_holed(logs, "netem", (4 * S, FOREVER)), scenario)["verdicts"]]
    assert not any("at this rate" in line for line in lines)


@pytest.mark.parametrize(
    ("duration_s", "patient", "reason"),
    [
        (3.0, [], "no message is known to have reached the patient"),
        (
            2.5,
            [message(COMMAND, 0, 400, log_ms=500)],
            "ticks count from 2 s after the first arrival (at 0.500 s), when filters have settled, and the run "
            "lasts 2.5 s",
        ),
        (
            9.0,
            [message(COMMAND, 0, 400, log_ms=500)],
            "there is no tick at which both the truth and hold's estimate are known",
        ),
    ],
)
def test_why_no_tick_counts(tmp_path: Path, duration_s: float, patient: list[Any], reason: str) -> None:
    logs = write_run(tmp_path, patient=patient)
    problems = build_summary(logs, a_scenario(duration_s=duration_s), (), "live", 0, "")["problems"]
    assert f"accuracy: no tick could be scored: {reason}" in causes(problems)
