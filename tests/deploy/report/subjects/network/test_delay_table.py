"""Literal summaries: what a direction's rows are when its keys are asked for the same, and when not."""

from typing import Any

import pytest

from tests.deploy.report.partial import part
from tis.common.metrics.percentiles import summarise
from tis.deploy.report.subjects.network.link_figures import Link
from tis.deploy.report.subjects.network.link_tables import delay_table, packet_table


def _part(asked_ms: float | None, decided_ms: float, varies: bool = False, foreign: bool = False) -> dict[str, Any]:
    def all_of(value: float | None) -> dict[str, float | None]:
        return dict.fromkeys(("mean", "std", "p50", "p95", "p99", "max"), value)

    return {
        "foreign": foreign,
        "delay_ms": {"requested": all_of(asked_ms), "decided": all_of(decided_ms), "realised": all_of(decided_ms)},
        "requested": {"varies": varies, "loss_pct": 1.0, "mean_burst": 1.0},
        "loss_pct": 2.0,
        "loss_pct_interval_95": [1.0, 3.0],
        "loss_runs": {"mean": 1.5},
        "queued_ms": {"mean": 0.0},
        "release_error_us": dict.fromkeys(("p50", "p95", "p99", "max"), 7.0),
    }


def _rows(**links: dict[str, Any]) -> tuple[list[Any], str]:
    table = delay_table({way: part(Link, link) for way, link in links.items()})  # type: ignore[misc]
    return list(table.rows), table.note


def _link(whole: dict[str, Any], keys: dict[str, Any], n_not_listed: int = 0) -> dict[str, Any]:
    return {**whole, "keys": keys, "keys_not_listed": n_not_listed}


def test_keys_that_are_asked_for_the_same_are_one() -> None:
    rows, notes = _rows(forward=_link(_part(30, 31), {"a": _part(30, 30), "b": _part(30, 32)}))
    assert [row[0] for row in rows] == [
        "forward requested, ms", "forward decided, ms", "forward realised, ms", "forward release error, \u00b5s",
    ]  # fmt: skip
    assert rows[0][1:] == (30, 30, 30, 30, 30, 30, 1.0, None, 1.0)
    assert rows[1][1:] == (31, 31, 31, 31, 31, 31, None, None, None)
    assert rows[2][1:] == (31, 31, 31, 31, 31, 31, 2.0, "1.00 to 3.00", 1.5)
    assert rows[3][1:] == (None, None, 7, 7, 7, 7, None, None, None)
    assert notes.endswith("in a row: mean number of messages lost without one between them")


def test_keys_that_are_asked_for_different_things_stand_by_themselves() -> None:
    keys = {"demo/pose": _part(30, 31), "demo/alarm": _part(0, 0), "demo/refused": _part(None, 0)}
    rows, notes = _rows(forward=_link(_part(None, 20), keys))
    names = [row[0] for row in rows]
    assert [name for name in names if not name.startswith(" ")] == [
        "forward, demo/pose", "forward, demo/alarm", "forward, demo/refused",
    ]  # fmt: skip
    assert names.count("  requested, ms") == 2
    assert names.count("  decided, ms") == 3
    assert "*" not in notes


def test_the_first_of_each_request_is_shown_and_what_does_not_fit_is_counted() -> None:
    keys = {f"demo/{i}": _part(30, 30) for i in range(6)} | {"demo/alarm": _part(0, 0)}
    rows, notes = _rows(feedback=_link(_part(None, 20), keys, 10))
    heads = [row[0] for row in rows if set(row[1:]) == {None}]
    assert heads == ["feedback, demo/0", "feedback, demo/alarm", "feedback, demo/1", "feedback, demo/2"]
    assert notes.endswith("; 13 more keys feedback: see summary.json")


def test_a_long_key_keeps_its_end_and_strangers_are_left_out() -> None:
    long = "tis/robots/left/arm/of/the/patient/measured_cp"
    keys = {long: _part(30, 30), "b": _part(0, 0), "other (foreign)": _part(5, 5, foreign=True)}
    rows, _ = _rows(forward=_link(_part(None, 20), keys))
    heads = [row[0] for row in rows if set(row[1:]) == {None}]
    assert heads == ["forward, ...the/patient/measured_cp", "forward, b"]
    assert max(map(len, heads)) <= len("feedback, ") + 26


@pytest.mark.parametrize(
    ("realised_ms", "late_us", "causes"),
    [
        (480.0, 449_950.0, ["left later than decided, by the release error"]),
        (480.0, 0.0, ["waited for earlier ones, in their order (fifo) or in a queue"]),
        (480.0, 200_000.0, [
            "left later than decided, by the release error",
            "waited for earlier ones, in their order (fifo) or in a queue",
        ]),
        (30.05, 50.0, []),
    ],
)  # fmt: skip
def test_what_realised_has_more_than_decided_is_told_by_its_cause(
    realised_ms: float, late_us: float, causes: list[str]
) -> None:
    link = _link(_part(30, 30), {})
    link["delay_ms"]["realised"] = dict.fromkeys(link["delay_ms"]["realised"], realised_ms)
    link["release_error_us"] = dict.fromkeys(("p50", "p95", "p99", "max"), late_us)
    _, notes = _rows(forward=link)
    found = [part for part in notes.split("; ") if part.startswith("realised exceeds decided")]
    assert found == ([f"realised exceeds decided: messages {', and '.join(causes)}"] if causes else [])


@pytest.mark.parametrize("late_ms", [[3.0], [0.05] * 9 + [3.0], [0.05] * 90 + [0.5] * 8 + [1.0, 9.0]])
@pytest.mark.parametrize("queued_ms", [0.0, 0.5])
def test_lateness_of_a_few_messages_is_no_wait(late_ms: list[float], queued_ms: float) -> None:
    """Nothing is injected: what realised delays have more is the release error, but for what a queue has."""
    link = _link(_part(0, 0), {})
    found = summarise(late_ms, (50, 95, 99), ("mean", "max"))
    link["delay_ms"]["realised"] = link["delay_ms"]["realised"] | {"mean": (found["mean"] or 0.0) + queued_ms}
    link["release_error_us"] = {name: 1000 * (found[name] or 0.0) for name in ("p50", "p95", "p99", "max")}
    link["queued_ms"] = {"mean": queued_ms}
    _, notes = _rows(forward=link)
    assert ("in a queue" in notes.partition("realised exceeds decided")[2]) == (queued_ms > 0)
    assert queued_ms or "messages left later than decided, by the release error" in notes


def test_what_changes_came_upon_is_marked_and_said_once() -> None:
    link = _link(_part(30, 40, varies=True), {"a": _part(30, 40, varies=True)})
    rows, notes = _rows(forward=link, feedback=link)
    marked = [row[0] for row in rows if "*" in row[0]]
    assert marked == ["forward requested*, ms", "feedback requested*, ms"]
    assert notes.count("; *: without outages, steps and the changes by ") == 1


def test_messages_that_waited_for_earlier_ones_are_told() -> None:
    waited = _part(30, 31)
    waited["delay_ms"]["realised"] = waited["delay_ms"]["realised"] | {"mean": 33.0}
    assert "in their order (fifo)" in _rows(forward=_link(waited, {}))[1]
    assert "fifo" not in _rows(forward=_link(_part(30, 31), {}))[1]


def test_what_a_recovery_sent_again_is_told_beside_what_was_dropped() -> None:
    names = ["sent", "offered", "copied", "released", "received", "unplanned_loss", "held_at_end", "reordered"]
    names += ["duplicated", "duplicated_by_netem", "corrupted", "corrupted_rejected", "foreign", "dropped", "untold"]
    lossless = dict.fromkeys(names, 0) | {"loss_pct": 0.0, "loss_pct_interval_95": [0.0, 1.0], "dropped_by": {}}
    for n, told in ((11, [("sent again by the recovery", 11)]), (0, [])):
        rows = packet_table({"forward": part(Link, lossless | {"recovered": n})}).rows
        assert [row for row in rows if "again" in row[0]] == told
