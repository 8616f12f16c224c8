"""Verdicts on requirements as tables and lists of the page."""

from collections.abc import Sequence
from html import escape
from typing import Final

from tis.common.metrics.verdict import Outcome
from tis.deploy.present.numbers import NONE, percentile_name, rounded_count, significant, with_margin
from tis.deploy.present.page import folded
from tis.deploy.present.table import Cell, Column, Table
from tis.deploy.report.subjects.requirements import OUT_OF_REACH, Finding, SetVerdict, split_by_reach

WORDS: Final[dict[Outcome, tuple[str, str]]] = {
    "met": ("met", "good"),
    "missed": ("missed", "bad"),
    "not_decidable": ("not decidable", "open"),
}
_ORDER: Final[tuple[Outcome, ...]] = ("missed", "not_decidable", "met")


def verdict_tables(verdicts: Sequence[SetVerdict], rate_hz: int) -> str:
    """Return a row for each set of requirements, and a folded table of each requirement in numbers."""
    if not verdicts:
        return ""
    near, far = split_by_reach(verdicts, rate_hz)
    rows = [row for verdict in near for row in _set_rows(verdict)]
    columns = ("requirements", Column("verdict", words=True), Column("why", words=True))
    details = "".join(_findings(verdict).html() for verdict in verdicts)
    words = far and f"Out of reach at {rate_hz} Hz: {far}."
    return Table("Verdict on each set of requirements", columns, rows, words).html() + folded(
        "Each requirement in numbers, and who requires it", details
    )


def outcome_list(verdicts: Sequence[SetVerdict], rate_hz: int) -> str:
    """Return a line with the outcome of each set of requirements; "" without any."""
    near, far = split_by_reach(verdicts, rate_hz)
    items = "".join(f"<li>{_chip(verdict.outcome).markup}{escape(verdict.title)}</li>" for verdict in near)
    items += f'<li><strong class="open">{OUT_OF_REACH}</strong>{escape(far)}</li>' if far else ""
    lead = '<p>Measured against the <a href="#requirements">requirements of applications</a>:</p>'
    return f'{lead}<ul class="outcomes">{items}</ul>' if items else ""


def _set_rows(verdict: SetVerdict) -> Sequence[tuple[str, str, str]]:
    """Return a set's row; the scenario's own limits have a row each, those missed first."""
    if verdict.name != "own":
        return [(verdict.title, _chip(verdict.outcome), _why(verdict))]
    each = sorted(verdict.findings, key=lambda one: _ORDER.index(one.outcome))
    each_row = [
        (f"\u2013 {_title(one)}", _chip(one.outcome), one.sentence.removeprefix(f"{one.title}: ")) for one in each
    ]
    return [(verdict.title, _chip(verdict.outcome), ""), *each_row]


def _title(one: Finding, figure: str = "") -> str:
    return one.title + figure + ("" if one.binding else " (strict end, not binding)")


def _why(verdict: SetVerdict) -> str:
    """Return the verdict's line without the title and outcome that its row has."""
    rest = verdict.line.removeprefix(f"{verdict.title}: {WORDS[verdict.outcome][0]}").strip()
    return rest[1:-1] if rest.startswith("(") and rest.endswith(")") else rest


def _findings(verdict: SetVerdict) -> Table:
    rows = [
        (
            _title(one, "".join(f", {word}" for word in (percentile_name(one.percentile), one.unit) if word)),
            _chip(one.outcome),
            significant(one.limit, 6),
            with_margin(one.value, one.uncertainty),
            one.excess,
            one.n,
            _needed(one),
        )
        for one in verdict.findings
    ]
    columns = (
        "requirement", Column("verdict", words=True), "limit", "measured", "missed by", "samples", "needed to decide",
    )  # fmt: skip
    return Table(verdict.title, columns, rows, f"Source: {verdict.source}.")


def _needed(one: Finding) -> str:
    if one.obstacle in ("clock", "unknown"):
        return "better clocks" if one.obstacle == "clock" else "not measured"
    return NONE if one.n_needed is None else f"about {rounded_count(one.n_needed)}"


def _chip(outcome: Outcome) -> Cell:
    word, look = WORDS[outcome]
    return Cell(word, markup=f'<strong class="{look}">{word}</strong>')
