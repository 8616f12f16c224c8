"""The summary as a whole: what is late, what is missing, what makes a run invalid."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from msgspec import structs

from tests.deploy.report.hand_made import (
    ARM,
    COMMAND,
    ESTIMATED,
    a_scenario,
    answer,
    counter,
    crossing,
    estimate,
    fate,
    fresh,
    message,
    tick,
    truth,
    write_log,
    write_run,
)
from tests.deploy.report.partial import causes
from tests.patient_side.arm_models import static_model
from tis.common.errors import EXIT_OK
from tis.common.messages import Message, encode
from tis.common.node import Record
from tis.common.scenario import Scenario
from tis.deploy.logs.read.load import RunLogs, load_run
from tis.deploy.report.summarise import build_summary

LEFT = static_model()
RIGHT = replace(LEFT, hand="right", arm="PSM1")
SIDES = ("surgeon", "netem", "patient")


def _summary(logs: RunLogs, scenario: Scenario, models: tuple[Any, ...] = (LEFT,)) -> dict[str, Any]:
    summary = build_summary(logs, scenario, models, "live", EXIT_OK, "tis run by_hand.yaml")
    json.dumps(summary, allow_nan=False)  # what is written must be JSON
    return summary


def _three_samples() -> dict[str, list[Record]]:
    """Commands sampled at 0, 33, 66 ms; each crosses in 10 ms; ticks 15 ms after the samples; answers cross in 10 ms.

    The arm's estimates are scored late in a run only, so three far ticks follow for them.
    """
    surgeon = [
        message(COMMAND, 0, 0.5, sample_ms=0),
        message(COMMAND, 1, 33.7, sample_ms=33),
        message(COMMAND, 2, 66.9, sample_ms=66),
        *(answer(k, 33 * k + 18, 33 * k, log_ms=33 * k + 29) for k in range(3)),
        *(tick(k, 33 * k, 33 * k + 0.2) for k in range(3)),
        *(truth(k, 100 * k, (0.001 * k, 0, 0)) for k in range(60)),
        counter("rejected", 0),
    ]
    netem = [
        *crossing(COMMAND, 0, 0.5),
        *crossing(COMMAND, 1, 33.7),
        *crossing(COMMAND, 2, 66.9),
        *(record for k in range(3) for record in crossing(ESTIMATED, k, 33 * k + 18, "feedback")),
    ]
    patient = [
        message(COMMAND, 0, 0.5, log_ms=11.0, sample_ms=0),
        message(COMMAND, 1, 33.7, log_ms=44.0, sample_ms=33),
        message(COMMAND, 2, 66.9, log_ms=77.0, sample_ms=66),
        *(tick(k, 33 * k + 15, 33 * k + 15 + late) for k, late in enumerate((0.1, 0.4, 0.2))),
        *(fresh(k, k, 33 * k) for k in range(3)),
        *(answer(k, 33 * k + 18, 33 * k) for k in range(3)),
        *(estimate(k, 2100 + 100 * k, "hold", (0.020 + 0.001 * k, 0, 0)) for k in range(3)),
        counter("rejected", 4),
        counter("superseded", 6),
    ]
    return {"surgeon": surgeon, "netem": netem, "patient": patient}


def test_the_parts_of_latency_are_those_on_the_way_of_each_used_sample(tmp_path: Path) -> None:
    summary = _summary(write_run(tmp_path, **_three_samples()), a_scenario())
    assert summary["problems"] == []
    assert summary["valid"]
    latency = summary["latency_ms"]
    # ways (ms):   sample  sent  received  begun  published
    #                 0     0.5    11.0     15.1     18
    #                33    33.7    44.0     48.4     51
    #                66    66.9    77.0     81.2     84
    parts = {
        "surgeon": (0.7, 0.9),
        "network": (10.3, 10.5),
        "tick_wait": (4.2, 4.4),
        "compute": (2.8, 2.9),
        "end_to_end": (18, 18),
        "round_trip": (29, 29),
        "network_round_trip": (21.3, 21.5),  # there, and 11 ms back
    }
    for name, (median, largest) in parts.items():
        assert latency[name]["p50"] == pytest.approx(median), name
        assert latency[name]["max"] == pytest.approx(largest), name
    assert summary["ticks"]["lateness_us"] == {"p50": 200, "p95": 400, "p99": 400, "max": 400}
    assert summary["surgeon_ticks"]["lateness_us"]["max"] == 200
    assert summary["superseded"] == 6
    assert summary["rejected"] == {"surgeon": 0, "patient": 4}


def test_parts_of_a_single_sample_add_up(tmp_path: Path) -> None:
    """With one sample, percentiles are that sample's and must add up to the ns."""
    logs = write_run(
        tmp_path,
        patient=[
            message(COMMAND, 5, 1.234567, log_ms=13.000001, sample_ms=1.0),
            message(COMMAND, 5, 1.234567, log_ms=19, sample_ms=1.0),  # a duplicate: the first arrival counts
            tick(9, 20, 20.000777),
            fresh(9, 5, 1.0),
            answer(9, 23.5, 1.0),
        ],
    )
    latency = _summary(logs, a_scenario())["latency_ms"]
    assert latency["network"]["p50"] == pytest.approx(11.765434, abs=1e-9)
    assert sum(latency[part]["p99"] for part in ("surgeon", "network", "tick_wait", "compute")) == pytest.approx(
        latency["end_to_end"]["p99"], abs=1e-9
    )
    assert latency["end_to_end"]["p99"] == pytest.approx(22.5, abs=1e-9)


def test_a_round_trip_ends_with_the_first_answer_that_carries_the_command(tmp_path: Path) -> None:
    logs = write_run(
        tmp_path,
        surgeon=[
            answer(0, 20, None, log_ms=30),  # before any command had come
            answer(1, 50, 7, log_ms=70),
            answer(2, 83, 7, log_ms=60),  # carries the same command, and came earlier
        ],
    )
    assert _summary(logs, a_scenario())["latency_ms"]["round_trip"] == dict.fromkeys(("p50", "p95", "p99", "max"), 53)


def test_ticks_that_are_missed_or_never_happened_make_a_run_invalid(tmp_path: Path) -> None:
    records = _three_samples()
    kept = [record for record in records["patient"] if record.topic != "/tis/ticks"]
    ticks = [tick(0, 15, 15.1), tick(1, 48, 90, missed=True)]
    summary = _summary(write_run(tmp_path, **(records | {"patient": [*kept, *ticks]})), a_scenario())
    assert (summary["ticks"]["count"], summary["ticks"]["missed"]) == (2, 1)
    assert summary["ticks"]["lateness_us"]["max"] == 100  # a missed tick has no lateness
    assert causes(summary["problems"]) == [
        "ticks: 2 of 3 happened, the run ended early",
        "ticks: 1 of 2 missed, the machine is too busy",
    ]
    assert not summary["valid"]


@pytest.mark.parametrize(
    ("kind", "code", "is_early"), [("live", 130, False), ("live", 3, True), ("synthetic", 130, True)]
)
def test_only_a_drive_may_be_ended_by_an_interrupt(tmp_path: Path, kind: str, code: int, is_early: bool) -> None:
    records = _three_samples()
    kept = [record for record in records["patient"] if record.topic != "/tis/ticks"]
    logs = write_run(tmp_path, **(records | {"patient": [*kept, tick(0, 15, 15.1), tick(1, 48, 48.1)]}))
    changes: dict[str, Any] = {"source": {"kind": kind}}
    if kind == "live":
        changes |= {"patient": {"plant": {"kind": "servo"}}, "identification": {"train": "synthetic"}}
    scenario = a_scenario(**changes)
    summary = build_summary(logs, scenario, (LEFT,), "live", code, "tis run by_hand.yaml")
    assert any("the run ended early" in text for text in summary["problems"]) == is_early


def test_loss_that_nobody_planned_makes_a_run_invalid(tmp_path: Path) -> None:
    records = _three_samples()
    records["patient"] = [r for r in records["patient"] if (r.topic, r.seq) != (COMMAND, 2)]
    summary = _summary(write_run(tmp_path, **records), a_scenario())
    assert causes(summary["problems"]) == [
        "rejected: the patient rejected 4 messages: no header of the testbed, another run's number, or no such pose",
        "links.forward: 1 of 3 lost that nobody planned",
    ]


@pytest.mark.parametrize("missing", [*SIDES, None])
def test_without_logs_the_summary_has_nulls_and_names_what_is_missing(tmp_path: Path, missing: str | None) -> None:
    """With ``None`` there is no log at all."""
    for side, records in _three_samples().items():
        if missing is not None and side != missing:
            write_log(tmp_path, side, records)  # type: ignore[arg-type]
    summary = _summary(load_run(tmp_path), a_scenario(), () if missing is None else (LEFT,))
    assert not summary["valid"]
    for side in SIDES:
        named = f"{side}: log is missing" in causes(summary["problems"])
        assert named == (missing in (side, None)), side
    if missing in ("patient", None):
        assert summary["ticks"]["count"] is summary["superseded"] is None
        assert summary["latency_ms"]["end_to_end"]["p50"] is None
        assert not any("ended early" in text for text in summary["problems"])
    if missing in ("surgeon", None):
        assert summary["latency_ms"]["round_trip"]["p50"] is None
        assert summary["accuracy"] == {}
    if missing in ("netem", None):
        assert summary["links"]["forward"]["loss_pct"] is None


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("n_bytes", [0, 5, 8, 700])
def test_a_torn_log_is_a_problem_and_never_a_traceback(tmp_path: Path, side: str, n_bytes: int) -> None:
    """A side that is killed before the first flush leaves an empty file."""
    for name, records in _three_samples().items():
        write_log(tmp_path, name, records)  # type: ignore[arg-type]
    path = tmp_path / f"{side}.mcap"
    path.write_bytes(path.read_bytes()[:n_bytes])
    summary = _summary(load_run(tmp_path), a_scenario())
    assert any(text.startswith(f"{side}: log is damaged (") for text in summary["problems"])
    assert not summary["valid"]


def test_every_cut_of_every_log_gives_a_summary(tmp_path: Path) -> None:
    for name, records in _three_samples().items():
        write_log(tmp_path, name, records)  # type: ignore[arg-type]
    for side in SIDES:
        path = tmp_path / f"{side}.mcap"
        whole = path.read_bytes()
        for cut in range(0, len(whole), 131):
            path.write_bytes(whole[:cut])
            assert not _summary(load_run(tmp_path), a_scenario())["valid"]
        path.write_bytes(whole)
    assert _summary(load_run(tmp_path), a_scenario())["valid"]


def test_limits_are_met_missed_or_not_decidable(tmp_path: Path) -> None:
    """End to end is 18 ms; one of four commands is lost; no feedback was offered."""
    records = _three_samples()
    netem = [r for r in records["netem"] if b"feedback" not in _json(r)]
    netem.append(fate(ARM, 0, 1, None, "loss"))
    records |= {"netem": netem, "surgeon": [*records["surgeon"], message(ARM, 0, 0.8)]}
    logs = write_run(tmp_path, **records)
    own = _summary(logs, a_scenario(limits={"end_to_end_p99_ms": 18, "p_loss_max": 0.25}))["verdicts"][0]
    assert (own["name"], own["outcome"]) == ("own", "not_decidable")
    assert [(f["metric"], f["direction"], f["limit"], f["value"], f["outcome"]) for f in own["findings"]] == [
        ("end_to_end", None, 18, 18, "not_decidable"),
        ("loss", "forward", 25, 25, "not_decidable"),
        ("loss", "feedback", 25, 0, "not_decidable"),
    ]
    assert [f["n_needed"] for f in own["findings"]] == [299, None, 11]  # 0.99^n, and 0.75^n, below 5 %
    missed = _summary(logs, a_scenario(limits={"end_to_end_p99_ms": 17.9, "p_loss_max": 0.001}))["verdicts"][0]
    assert [f["outcome"] for f in missed["findings"]] == ["missed", "missed", "not_decidable"]
    assert missed["findings"][0]["excess"] == pytest.approx(0.1)
    assert missed["findings"][1]["excess"] == pytest.approx(24.9)
    assert missed["outcome"] == "missed"
    others = [verdict["name"] for verdict in _summary(logs, a_scenario())["verdicts"]]
    assert others[0] == "haptics"
    assert "tactile_internet" in others
    assert "own" not in others


def test_a_missed_limit_does_not_make_a_measurement_invalid(tmp_path: Path) -> None:
    summary = _summary(write_run(tmp_path, **_three_samples()), a_scenario(limits={"end_to_end_p99_ms": 1}))
    assert summary["verdicts"][0]["outcome"] == "missed"
    assert summary["valid"]


def test_two_hands_have_scores_models_and_ways_of_their_own(tmp_path: Path) -> None:
    records = _three_samples()
    key = "tis/MTMR/measured_cp"
    records["surgeon"] += [message(key, 0, 1, sample_ms=0)]
    records["surgeon"] += [truth(k, 100 * k, (0, 0.001 * k, 0), hand="right") for k in range(60)]
    records["netem"] += crossing(key, 0, 1)
    records["patient"] += [
        message(key, 0, 1, log_ms=11.5, sample_ms=0),
        fresh(0, 0, 0, key=key, hand="right"),
        # the right hand's answer to tick 0 comes out 2 ms after the left hand's
        structs.replace(answer(0, 20, 0), topic="tis/PSM1/estimated_cp"),
        # the right arm is at y = 21, 22, 23 mm: hold errs by 0, 0, 3 mm
        *(estimate(k, 2100 + 100 * k, "hold", (0, y, 0), hand="right") for k, y in enumerate((0.021, 0.022, 0.026))),
    ]
    records["netem"] += crossing("tis/PSM1/estimated_cp", 0, 20, "feedback")
    records["surgeon"] += [structs.replace(answer(0, 20, 0, log_ms=31), topic="tis/PSM1/estimated_cp")]
    scenario = a_scenario(source={"kind": "synthetic", "hands": ["left", "right"]})
    summary = _summary(write_run(tmp_path, **records), scenario, (LEFT, RIGHT))
    assert summary["problems"] == []
    by_hand = summary["accuracy_by_hand"]
    # pooled over both hands' ticks: 3 mm^2 of the left, 9 mm^2 of the right
    assert summary["accuracy"]["hold"]["rmse_3d_mm"] == pytest.approx((12 / 6) ** 0.5)
    assert summary["accuracy"]["hold"]["n_scored"] == 6
    assert by_hand["left"]["hold"]["rmse_3d_mm"] == pytest.approx(1)  # at 21, 22, 23 mm, hold says 20, 21, 22
    assert by_hand["right"]["hold"]["rmse_3d_mm"] == pytest.approx(3**0.5)
    assert set(summary["identification_by_hand"]) == {"left", "right"}
    # left: 18, 18, 18 ms, right: 20
    assert summary["latency_ms"]["end_to_end"]["p50"] == 18
    assert summary["latency_ms"]["end_to_end"]["max"] == 20
    assert summary["latency_ms"]["round_trip"]["max"] == 31
    assert summary["source"] == "synthetic surgeon, left and right hand"


def _json(record: Record) -> bytes:
    assert isinstance(record.data, Message)
    return encode(record.data)


def test_a_way_past_netem_makes_a_run_invalid(tmp_path: Path) -> None:
    records = _three_samples()
    logs = write_run(tmp_path, **(records | {"netem": [*records["netem"], counter("leaks", 1)]}))
    found = _summary(logs, a_scenario())
    assert "1 way past netem was found: messages crossed without it" in causes(found["problems"])
    assert not found["valid"]
