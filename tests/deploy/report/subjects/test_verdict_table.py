"""Verdicts as tables: each word where it belongs, every text escaped."""

from itertools import pairwise

from tests.deploy.report.outline import Outline
from tis.deploy.report.subjects.requirement_tables import outcome_list, verdict_tables
from tis.deploy.report.subjects.requirements import Finding, SetVerdict

MISSED = Finding.model_validate({
    "metric": "end_to_end", "direction": None, "title": "end-to-end latency", "binding": True, "unit": "ms",
    "limit": 50.0, "percentile": 99.0, "value": 68.7, "uncertainty": 0.25, "aside": "", "outcome": "missed",
    "obstacle": None, "excess": 18.7, "n": 1900, "n_outside": 900, "n_needed": None, "sentence": "-",
})  # fmt: skip
OPEN = Finding.model_validate({
    "metric": "loss", "direction": "forward", "title": "loss, forward", "binding": False, "unit": "%",
    "limit": 1e-5, "percentile": None, "value": 0.0, "uncertainty": None, "aside": "", "outcome": "not_decidable",
    "obstacle": "too_few", "excess": None, "n": 3600, "n_outside": 0, "n_needed": 29_957_322, "sentence": "-",
})  # fmt: skip
VERDICT = SetVerdict.model_validate({
    "name": "x", "title": "a <b>", "source": "RFC <0>", "outcome": "missed",
    "line": "a <b>: missed (end-to-end latency 68.7 instead of 50 ms)", "findings": [MISSED, OPEN],
})  # fmt: skip


def _rows(markup: str) -> list[list[str]]:
    page = Outline(markup)
    starts = [i for i, (name, _, _) in enumerate(page.elements) if name == "tr"] + [len(page.elements)]
    return [
        [page.words.get(i, "") for i in range(a, b) if page.elements[i][0] in ("th", "td")]
        for a, b in pairwise(starts)
    ]


def test_a_row_says_who_requires_it_whether_it_was_met_and_why() -> None:
    rows = _rows(verdict_tables([VERDICT], 30))
    assert rows[1] == ["a <b>", "missed", "end-to-end latency 68.7 instead of 50 ms"]
    assert rows[3] == ["end-to-end latency, p99, ms", "missed", "50", "68.70 ± 0.250", "18.70", "1900", "-"]
    assert rows[4] == [
        "loss, forward, % (strict end, not binding)", "not decidable", "0.00001", "0", "-", "3600",
        "about 30 million",
    ]  # fmt: skip


def test_all_text_is_escaped_and_the_source_named() -> None:
    markup = verdict_tables([VERDICT], 30)
    assert "<b>" not in markup
    assert "Source: RFC &lt;0&gt;." in markup


def test_what_stood_in_the_way_is_said() -> None:
    clock = OPEN.model_copy(update={"obstacle": "clock", "n_needed": None})
    unknown = OPEN.model_copy(update={"obstacle": "unknown", "value": None, "n": 0, "n_needed": None})
    rows = _rows(verdict_tables([VERDICT.model_copy(update={"findings": [clock, unknown]})], 30))
    assert [row[-1] for row in rows[3:]] == ["better clocks", "not measured"]
    assert rows[4][3] == "-"


def test_without_verdicts_there_is_no_table() -> None:
    assert verdict_tables([], 30) == ""


def test_ones_own_limits_have_a_row_each_missed_first() -> None:
    met = MISSED.model_copy(update={"title": "age", "outcome": "met", "sentence": "age: 3 ms, allowed 5 ms: met"})
    missed = MISSED.model_copy(update={"sentence": "end-to-end latency: 68.7 ms, allowed 50 ms: 18.7 ms too much"})
    rows = _rows(verdict_tables([VERDICT.model_copy(update={"name": "own", "findings": [met, OPEN, missed]})], 30))
    assert rows[1:5] == [
        ["a <b>", "missed", ""],
        ["\u2013 end-to-end latency", "missed", "68.7 ms, allowed 50 ms: 18.7 ms too much"],
        ["\u2013 loss, forward (strict end, not binding)", "not decidable", "-"],
        ["\u2013 age", "met", "3 ms, allowed 5 ms: met"],
    ]


def test_in_short_each_set_has_its_outcome_and_its_title() -> None:
    page = Outline(outcome_list([VERDICT], 30))
    assert page.faults() == [fault for fault in page.faults() if "needed" in fault or "id requirements" in fault]
    assert [text for _, text in page.all("li")] == ["misseda <b>"]
    assert outcome_list([], 30) == ""
