"""A profile is shown in as few rows as it has things to say, and none of its numbers is left out."""

import json
import re
from typing import Any

import pytest

from tests.deploy.commands import call
from tis.common.scenario.profile import Profile, numeric_paths
from tis.deploy.net.library import number_rows
from tis.deploy.net.profiles import build_profile, find_profile, shipped_names


def _fitted(feedback_ms: float = 1.0) -> Profile:
    points = [{"p": i / 40, "delay_ms": 1.0 + i} for i in range(41)]
    feedback = [{**point, "delay_ms": point["delay_ms"] * feedback_ms} for point in points]
    raw: dict[str, Any] = {
        "name": "fitted",
        "title": "Fitted",
        "sources": {"record": "a trace"},
        "network": {
            "forward": {"delay": {"kind": "quantiles", "points": points}, "correlation": {"half_life_s": 2}},
            "feedback": {"delay": {"kind": "quantiles", "points": feedback}, "correlation": {"half_life_s": 2}},
        },
        "numbers": [
            {"of": "*.delay", "source": "record", "basis": "fitted", "note": "41 quantiles"},
            {"of": "*.correlation", "source": "record", "basis": "fitted"},
        ],
    }
    return build_profile(raw, "test")


def test_points_are_one_row_and_equal_directions_one_block() -> None:
    assert [row[:2] for row in number_rows(_fitted())] == [
        ("both.delay.points", "41 points, p 0: 1 ms to p 1: 41 ms"),
        ("both.correlation.half_life_s", "2"),
    ]


def test_directions_that_differ_have_a_block_each() -> None:
    assert [row.of for row in number_rows(_fitted(2))] == [
        "forward.delay.points", "forward.correlation.half_life_s",
        "feedback.delay.points", "feedback.correlation.half_life_s",
    ]  # fmt: skip


def test_points_with_reasons_of_their_own_have_rows_of_their_own() -> None:
    rows = [row for row in number_rows(find_profile("starlink_2022_eu")) if ".points" in row.of]
    assert [(row.of, row.value) for row in rows[:2]] == [
        ("both.delay.points.0", "p 0: 10 ms"), ("both.delay.points.1", "p 0.25: 20 ms"),
    ]  # fmt: skip
    assert len(rows) == 6


@pytest.mark.parametrize("name", shipped_names())
def test_no_number_of_the_library_is_left_out(name: str) -> None:
    profile = find_profile(name)
    n_shown = 0
    for row in number_rows(profile):
        n = re.match(r"(\d+) points", row.value)
        n_numbers = 2 * int(n[1]) if n else 2 if row.value.startswith("p ") else 1
        n_shown += n_numbers * (2 if row.of.startswith("both.") else 1)
    assert n_shown == sum(1 for _ in numeric_paths(profile.partial()))


def test_a_stage_s_second_kind_does_not_repeat_what_the_first_has_alike() -> None:
    code, out, _ = call("net", "stages", "rate")
    assert code == 0
    assert out.count("queue.target_ms") == 1
    assert out.count("as above") == 1
    assert out.index("opportunity_bytes") < out.index("as above")


def test_the_delays_told_are_those_of_messages_that_keep_their_order() -> None:
    """`wifi_bad` draws a median below half a ms, which hardly any message has behind those that are late."""
    code, out, _ = call("net", "profiles", "wifi_bad")
    assert code == 0
    said = " ".join(out.split())
    assert re.search(r"mean (18|19|20)\S* ms, p50 1\.\S+, p99 12\S+ in order at 60 a second \(as drawn: mean 6", said)
    code, out, _ = call("net", "profiles", "wifi_bad", "--json")
    found = json.loads(out)
    assert found["figures"]["forward"]["p50_ms"] < 0.5 < 1 < found["in_order"]["forward"]["p50_ms"]
