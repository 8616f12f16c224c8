"""Tables of the verdicts on requirements."""

from collections.abc import Sequence
from html import escape
from typing import Final

from tis.common.metrics.verdict import Finding, Outcome, SetVerdict
from tis.deploy.report.tables.html_tables import folded, markup_table
from tis.deploy.report.tables.numbers import number
from tis.deploy.report.verdict.amounts import percentile_name, plain_number, rounded_count
from tis.deploy.report.verdict.verdict_text import OUT_OF_REACH, outcome_text

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
    rows = [row for verdict in verdicts for row in _rows(verdict, rate_hz)]
    details = "".join(_findings(verdict) for verdict in verdicts)
    table = markup_table(
        "Verdict on each set of requirements", ("requirements", "verdict", "why"), rows, texts=(1, 2)
    )
    return table + folded("Each requirement in numbers, and who requires it", details)


def outcome_list(verdicts: Sequence[SetVerdict], rate_hz: int) -> str:
    """Return a line with the outcome of each set of requirements; "" without any."""
    items = "".join(f"<li>{_set_chip(verdict, rate_hz)}{escape(verdict['title'])}</li>" for verdict in verdicts)
    lead = '<p>Measured against the <a href="#requirements">requirements of applications</a>:</p>'
    return f'{lead}<ul class="outcomes">{items}</ul>' if items else ""


def _rows(verdict: SetVerdict, rate_hz: int) -> list[tuple[str, str, str]]:
    """Return a set's row; the scenario's own limits have a row each, those missed first."""
    if verdict["name"] != "own":
        return [(escape(verdict["title"]), _set_chip(verdict, rate_hz), escape(_why(verdict)))]
    each = sorted(verdict["findings"], key=lambda one: _ORDER.index(one["outcome"]))
    return [(escape(verdict["title"]), _set_chip(verdict, rate_hz), "")] + [
        (f"\u2013 {_title(one)}", _chip(one["outcome"]), escape(one["sentence"].removeprefix(f"{one['title']}: ")))
        for one in each
    ]


def _title(one: Finding, figure: str = "") -> str:
    return escape(one["title"] + figure) + ("" if one["binding"] else " (strict end, not binding)")


def _figure(one: Finding) -> str:
    """Return the statistic of a requirement and its unit: ``, p99, ms``."""
    return "".join(f", {word}" for word in (percentile_name(one["percentile"]), one["unit"]) if word)


def _why(verdict: SetVerdict) -> str:
    """Return the verdict's line without the title and outcome that its row has."""
    shown = f"{verdict['title']}: {WORDS[verdict['outcome']][0]}"
    rest = verdict["line"].removeprefix(shown).strip()
    return rest[1:-1] if rest.startswith("(") and rest.endswith(")") else rest


def _findings(verdict: SetVerdict) -> str:
    rows = [
        (
            _title(one, _figure(one)),
            _chip(one["outcome"]),
            plain_number(one["limit"], 6),
            _measured(one),
            number(one["excess"]),
            number(one["n"]),
            _needed(one),
        )
        for one in verdict["findings"]
    ]
    head = ("requirement", "verdict", "limit", "measured", "missed by", "samples", "needed to decide")
    source = f'<p class="note">Source: {escape(verdict["source"])}.</p>'
    return markup_table(verdict["title"], head, rows, texts=(1,)) + source


def _measured(one: Finding) -> str:
    if one["value"] is None:
        return "-"
    return number(one["value"]) + (f" \u00b1 {number(one['uncertainty'])}" if one["uncertainty"] else "")


def _needed(one: Finding) -> str:
    if one["obstacle"] == "clock":
        return "better clocks"
    if one["obstacle"] == "unknown":
        return "not measured"
    return "-" if one["n_needed"] is None else f"about {rounded_count(one['n_needed'])}"


def _set_chip(verdict: SetVerdict, rate_hz: int) -> str:
    outcome = outcome_text(verdict, rate_hz)
    return f'<strong class="open">{outcome}</strong>' if outcome == OUT_OF_REACH else _chip(verdict["outcome"])


def _chip(outcome: Outcome) -> str:
    word, look = WORDS[outcome]
    return f'<strong class="{look}">{word}</strong>'
