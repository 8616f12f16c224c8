"""What a newcomer sees in a terminal."""

import io
import re
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from tests.deploy.report.hand_made import (
    COMMAND,
    a_scenario,
    answer,
    crossing,
    estimate,
    fate,
    fresh,
    message,
    tick,
    truth,
    write_run,
)
from tests.deploy.report.partial import causes, summary_of
from tests.patient_side.arm_models import static_model
from tis.common.scenario.limits import REQUIREMENTS
from tis.deploy.logs.read.load import load_run
from tis.deploy.report.summarise import build_summary
from tis.deploy.report.terminal import print_summary


def _seen(summary: dict[str, Any], width: int = 80) -> str:
    out = io.StringIO()
    print_summary(summary_of(summary), Console(file=out, width=width), verbose=True)
    return out.getvalue()


def _row(text: str, name: str) -> list[str]:
    line = next(line.strip() for line in text.splitlines() if line.strip().startswith(f"{name}  "))
    return line.removeprefix(name).split()


@pytest.fixture
def summary(tmp_path: Path) -> dict[str, Any]:
    """One command of two arrives; hold errs by 1 mm, the filter by 0.5 mm."""
    logs = write_run(
        tmp_path,
        surgeon=[
            message(COMMAND, 0, 0.5),
            message(COMMAND, 1, 33.5, sample_ms=33),
            tick(0, 0, 0.1),
            *(truth(k, 100 * k, (0.001 * k, 0, 0)) for k in range(60)),
        ],
        netem=[*crossing(COMMAND, 0, 0.5), fate(COMMAND, 1, 33.5, None, "loss")],
        patient=[
            message(COMMAND, 0, 0.5, log_ms=11),
            tick(0, 15, 15.25),
            fresh(0, 0, 0),
            answer(0, 18, 0),
            *(estimate(k, 2100 + 100 * k, "hold", (0.020 + 0.001 * k, 0, 0)) for k in range(3)),
            *(
                estimate(k, 2100 + 100 * k, "innovations_kf", (0.0205 + 0.001 * k, 0, 0), step_ns=41_000)
                for k in range(3)
            ),
        ],
    )
    scenario = a_scenario(limits={"end_to_end_p99_ms": 150, "p_loss_max": 0.1})
    return build_summary(logs, scenario, (static_model(),), "live", 0, "tis run by_hand.yaml")


def test_the_answer_comes_first(summary: dict[str, Any]) -> None:
    words = " ".join(_seen(summary).split())
    assert words.startswith(
        "by_hand (live, synthetic surgeon, left hand) This run is not a valid measurement: ticks: 1 of 3 happened"
    )
    for figures in (
        "end to end median 18.00 ms, p99 18.00 ms, from a new sample to its estimate",
        "packets lost 50.00 % to the patient",
        "error innovations_kf 0.500 mm (RMSE in 3D), 50 % of the 1.000 mm of repeating the newest position (hold)",
        "age the newest sample was at most",
    ):
        assert figures in words


def test_problems_come_first_and_verdicts_last_a_line_each(summary: dict[str, Any]) -> None:
    lines = [line.rstrip() for line in _seen(summary).splitlines()]
    assert "  ticks: 1 of 3 happened, the run ended early" in causes(lines)
    last = lines[lines.index("Requirements of applications:") + 1 :]
    # one sample in time does not show that 99 % are; one of two lost shows more than 0.1 %, but not more than 10 %
    # one tick happened, in 33 ms
    words = "not decidable (end to end, loss; about 299 estimates with a new sample would tell, 10 s at this rate)"
    assert f"the scenario's limits: {words}" in " ".join(" ".join(last).split())
    words = "haptics (paper): out of reach at 30 Hz (loss, feedback 100 %, allowed 0.1 %; 3 more missed)"
    assert words in " ".join(" ".join(last).split())
    assert len([line for line in last if re.match(r"  \S", line)]) == 1 + len(REQUIREMENTS)


def test_the_tables_hold_the_summarys_figures_and_fit_80_columns(summary: dict[str, Any]) -> None:
    text = _seen(summary)
    assert max(len(line) for line in text.splitlines()) <= 80
    assert "…" not in text
    assert _row(text, "dropped by netem")[0] == "1"
    assert _row(text, "dropped because of loss")[0] == "1"
    assert _row(text, "forward decided, ms") == ["10.00", "10.00", "10.00", "10.00", "-", "-"]
    # p50, p95, p99, max
    assert _row(text, "surgeon (sample taken to sent)") == ["0.500"] * 4
    assert _row(text, "= end to end") == ["18.00"] * 4
    assert _row(text, "round trip (surgeon's clock)") == ["-"] * 4
    # R2 of x: the truth is -1, 0, 1 mm about its mean, the errors 0.5 mm: 1 - 0.75 / 2
    assert _row(text, "innovations_kf") == ["0.500", "50", "62.50", "-", "-", "41.00", "41.00"]
    words = " ".join(text.split())
    assert "ticks 1 at 30 Hz, 0 missed, 3 scored; the surgeon missed 0" in words
    assert "begun late by median 250.0, p99 250.0 µs" in words
    assert "static relation, order 0" in words
    assert "redundancy" not in words


def test_missed_ticks_of_both_sides_are_told_apart(summary: dict[str, Any]) -> None:
    missed = {name: {**summary[name], "missed": n} for name, n in (("ticks", 2), ("surgeon_ticks", 3))}
    assert "2 missed, 3 scored; the surgeon missed 3" in " ".join(_seen(summary | missed).split())


def test_what_redundancy_cost_and_gained_is_a_table_in_80_columns(summary: dict[str, Any]) -> None:
    found = {
        "copies": 4,
        "copy_spacing_ms": 8.0,
        "history": 0,
        "price": {"packets_per_s": 240.0, "bytes_per_s": 64e3, "packets_per_s_once": 60.0, "bytes_per_s_once": 16e3},
        "lost": {"packets_pct": 1.06, "samples_pct": 0.02, "samples_once_pct": 1.0, "packets": 4800, "samples": 1200},
        "age_ms": {"mean": 66.6, "p95": 102.0},
        "age_once_ms": {"mean": 86.2, "p95": None},
    }
    text = _seen(summary | {"redundancy": found})
    assert max(len(line) for line in text.splitlines()) <= 80
    words = " ".join(text.split())
    assert "samples sent each sample 4 times, 8 ms apart: 0.02 % of the samples never arrived" in words
    assert _row(text, "packets/s") == ["240.0", "60.00"]
    assert _row(text, "kB/s") == ["64.00", "16.00"]
    assert _row(text, "packets that never arrived, %") == ["1.06", "1.00"]
    assert _row(text, "samples that never arrived, %") == ["0.020", "1.00"]
    assert _row(text, "age at the ticks, mean, ms") == ["66.60", "86.20"]
    assert _row(text, "age at the ticks, p95, ms") == ["102.0", "-"]
    assert "sent by the surgeon: 240.0 packets/s, 64.00 kB/s" in words


def test_of_nothing_a_summary_is_printed_all_the_same(tmp_path: Path) -> None:
    scenario = a_scenario(limits={"end_to_end_p99_ms": 150, "p_loss_max": 0.05})
    summary = build_summary(load_run(tmp_path), scenario, (), "live", None, "")
    text = _seen(summary)
    assert "end to end median -, p99 -, from a new sample to its estimate" in " ".join(text.split())
    assert "patient: log is missing" in text
    assert "  the scenario's limits: not decidable (end to end, loss)" in text
    assert text.count(": not decidable (") == 1 + len(REQUIREMENTS)
    assert text.count("not decidable, too little was sent") == 2
    assert "None" not in text
    assert _row(text, "released") == ["-"] * 2


def test_without_a_scored_tick_the_table_of_estimators_has_dashes(tmp_path: Path) -> None:
    """A run of less than two seconds: estimates, but none that counts."""
    logs = write_run(
        tmp_path,
        surgeon=[truth(0, 0, (0, 0, 0)), truth(1, 33, (0, 0, 0))],
        patient=[
            message(COMMAND, 0, 0, log_ms=11),
            estimate(0, 15, "hold", None),
            estimate(0, 15, "innovations_kf", None),
        ],
    )
    text = _seen(build_summary(logs, a_scenario(), (static_model(),), "twin", 0, ""))
    assert _row(text, "innovations_kf") == ["-"] * 5  # nobody measures steps in virtual time: no column for them


def test_the_verdict_names_what_was_violated_and_not_everything(summary: dict[str, Any]) -> None:
    verdict = {
        "faithful": False,
        "violations": [f"loss {k}" for k in range(8)],
        "not_decidable": [],
        "warnings": ["w"],
    }
    links = {**summary["links"], "forward": {**summary["links"]["forward"], "verdict": verdict}}
    text = _seen(summary | {"links": links})
    assert "network forward: not faithful to the scenario" in text
    assert "    loss 5\n" in text.replace(" \n", "\n")
    assert "loss 6" not in text
    assert "and 3 more, see summary.json" in text


def test_two_hands_have_a_table_each(summary: dict[str, Any]) -> None:
    text = _seen(summary | {"accuracy_by_hand": {"left": summary["accuracy"], "right": summary["accuracy"]}})
    assert "Accuracy at the tick, left hand" in text
    assert "Accuracy at the tick, right hand" in text


@pytest.mark.parametrize("hostile", ["[red]", "[/]", "[link=x]"])
def test_words_that_look_like_markup_are_shown_as_they_are(summary: dict[str, Any], hostile: str) -> None:
    summary["problems"] = [f"netem: log is damaged ({hostile})"]
    assert f"  netem: log is damaged ({hostile})" in _seen(summary)


def test_a_partly_undecidable_network_is_faithful_as_far_as_can_be_told(
    summary: dict[str, Any],
) -> None:
    verdict = {"faithful": True, "violations": [], "not_decidable": ["x"], "warnings": [], "undecided": {"loss": 450}}
    links = {**summary["links"], "forward": {**summary["links"]["forward"], "verdict": verdict}}
    words = " ".join(_seen(summary | {"links": links}).split())
    assert "network forward: faithful to the scenario in all that could be judged" in words
    assert "(loss: not decidable with 450 messages)" in words


def test_a_fit_that_is_not_all_is_not_shown_as_all(summary: dict[str, Any]) -> None:
    model = {**summary["identification"], "fit_pct": [99.99963, 100.0, -614.25]}
    assert "fit 99.999 100.000 -614.250 %" in " ".join(_seen(summary | {"identification": model}).split())
