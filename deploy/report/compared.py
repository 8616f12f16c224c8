"""``compare.html``: several runs side by side on one self-contained page, and how their scenarios differ."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any, Final, NamedTuple

from tis.common.scenario import Scenario
from tis.deploy.present.numbers import number
from tis.deploy.present.page import Page, Section, page_html
from tis.deploy.present.table import Column, Table
from tis.deploy.report.run_view import HandView, RunView
from tis.deploy.report.subjects.accuracy import Scores
from tis.deploy.report.subjects.network.disturbances import Disturbance, disturbances_text
from tis.deploy.report.subjects.redundancy import kilo
from tis.deploy.report.summary import Summary

_ABSENT: Final = "-"
_NOT_A_DIFFERENCE: Final = ("name", "version")


@dataclass(frozen=True)
class Differences:
    """``fields`` maps the path of each field that differs to its value in each run, as text."""

    fields: dict[str, tuple[str, ...]]
    modes: tuple[str, ...]
    is_driven: bool = False
    """Whether a live device moved the hand in any of the runs."""

    @property
    def same_movement(self) -> bool:
        """Tell whether all runs show the same movement, so that their errors compare."""
        if self.is_driven:
            return False
        moving = [name for name in self.fields if name.startswith("source.") or name == "rate_hz"]
        return not set(moving) - {"source.hands"}

    def statement(self, changed_live: bool = False) -> str:
        """Return the differences and their meaning for the figures, in a sentence or two.

        After changes ``changed_live`` to the network of any run, nothing else can be the only cause.
        """
        names = list(self.fields)
        mixed = " Live and virtual time are mixed: their accuracy agrees statistically only."
        is_mixed = len(set(self.modes)) > 1
        tail = mixed if is_mixed else ""
        if changed_live:
            text = _beside_live_changes(names, self.is_driven)
        elif not names:
            cause = "the movement, or from the host" if self.is_driven else "the host they ran on"
            text = f"All runs have the same scenario and seed: what differs comes from {cause}."
        elif names == ["seed"] and not self.is_driven:
            text = "The runs differ in nothing but the seed: they are repetitions, and what differs is chance."
        elif len(names) == 1:
            cause = "it" + (", or from the kind of time" if is_mixed else "")
            cause += ", or from the movement" if self.is_driven else ""
            text = f"The runs differ in one field of the scenario, {names[0]}: what differs comes from {cause}."
        else:
            shown = ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")
            text = (
                f"The runs have different scenarios. They differ in {len(names)} fields ({shown}); what differs in "
                "the figures may come from any of them."
            )
        if self.is_driven:
            text += " A live device moved the hand, another way in each run, so errors in mm do not compare."
        elif not self.same_movement:
            text += " The movement or its rate is not the same, so errors in mm do not compare."
        return text + tail


def _beside_live_changes(names: Sequence[str], is_driven: bool) -> str:
    if not names:
        cause = "these changes, the movement, or the host" if is_driven else "these changes, or from the host"
        return f"All runs have the same scenario and seed: what differs comes from {cause}."
    fields = f"one field of the scenario, {names[0]}," if len(names) == 1 else f"{len(names)} fields of the scenario"
    return f"The runs differ in {fields} as well; what differs in the figures may come from either."


def scenario_differences(scenarios: Sequence[Scenario], modes: Sequence[str]) -> Differences:
    """Return the fields in which scenarios differ, names aside (oracle: edits by hand, test_scenario_differences)."""
    flat = [_flat(scenario.model_dump(mode="json", exclude_none=True)) for scenario in scenarios]
    paths = dict.fromkeys(path for one in flat for path in one)
    found = {path: tuple(one.get(path, _ABSENT) for one in flat) for path in paths}
    differing = {path: values for path, values in found.items() if len(set(values)) > 1}
    is_driven = any(scenario.source.kind == "live" for scenario in scenarios)
    return Differences(differing, tuple(modes), is_driven)


def _flat(value: Mapping[str, Any], path: str = "") -> dict[str, str]:
    found: dict[str, str] = {}
    for name, item in value.items():
        here = f"{path}.{name}" if path else name
        if here in _NOT_A_DIFFERENCE:
            continue
        if isinstance(item, Mapping) and item:
            found |= _flat(item, here)
        # lists of parts, as rules and states, are compared entry by entry
        elif isinstance(item, list) and any(isinstance(part, Mapping) for part in item):
            for i, part in enumerate(item):
                found |= _flat(part, f"{here}[{i}]") if isinstance(part, Mapping) else {f"{here}[{i}]": str(part)}
        else:
            found[here] = item if isinstance(item, str) else json.dumps(item)
    return found


_NUMBERS: Final = ("seed", "duration, s")


def compared_html(runs: Mapping[str, RunView]) -> str:
    """Return the page of two or more runs by name; the first is the baseline."""
    from tis.deploy.report.plots import compared as plots  # loads Bokeh

    views = {name: _view(run) for name, run in runs.items()}
    names, listed = list(runs), list(runs.values())
    differences = scenario_differences([run.scenario for run in listed], [run.summary.mode for run in listed])
    found = {name: run.disturbances for name, run in runs.items()}
    synthetic = any(run.synthetic for run in listed)
    tags = [(f"{len(runs)} runs", "")]
    if synthetic:
        tags.append(("synthetic movement, not a recording of a person", "open"))
    if differences.fields and list(differences.fields) != ["seed"]:
        tags.append(("different scenarios", "open"))
    changed = [name for name, each in found.items() if any(one.live for one in each)]
    tags += [(f"{name}: network changed while running", "open") for name in changed]
    tags += [(f"{name}: not a valid measurement", "bad") for name, run in runs.items() if not run.summary.valid]
    sections = [
        Section("answer", "The answer", markup=_answer(runs, differences, found) + figure_tables(names, listed)),
        Section(
            "distributions",
            "Distributions",
            [*plots.distributions(runs, views), plots.against_age(views)],
            beside=True,
        ),
        Section("error", "Error", [plots.over_time(views, found, differences.is_driven)]),
        Section("scenarios", "What differs in the scenarios", markup=_differences(names, differences)),
        Section("runs", "The runs", markup=_runs(runs)),
    ]
    return page_html(Page("Runs compared", "Runs compared", tags, sections))


def _answer(runs: Mapping[str, RunView], differences: Differences, found: Mapping[str, Sequence[Disturbance]]) -> str:
    """Return outages and live changes, the differences of the scenarios, and the runs with the least figures."""
    valid = {name: run for name, run in runs.items() if run.summary.valid}
    latencies = {name: run.summary.latency_ms.end_to_end["p50"] for name, run in valid.items()}
    errors = {n: _score(r.summary.accuracy, r.scenario.active_estimator, "rmse_3d_mm") for n, r in valid.items()}
    parts = [disturbances_text(name, each) for name, each in found.items()]
    parts.append(differences.statement(any(one.live for each in found.values() for one in each)))
    if len(valid) < len(runs):
        parts.append(f"No valid measurement, so not ranked: {', '.join(sorted(runs.keys() - valid.keys()))}.")
    if len({run.summary.mode for run in valid.values()}) == 1:  # virtual time has no computing time
        parts.append(_least("Least median end-to-end latency, of estimates with a new sample:", latencies, "ms"))
    if differences.same_movement:
        parts.append(_least("Least error (RMSE in 3D of the active estimator):", errors, "mm"))
    return f'<p class="answer">{escape(" ".join(filter(None, parts)))}</p>'


def _least(words: str, values: Mapping[str, float | None], unit: str) -> str:
    """Return the runs with the least value, and the values of the others; "" when all are equal."""
    known = {name: number(value) for name, value in values.items() if value is not None}
    least = min((value for value in values.values() if value is not None), default=None)
    best = [name for name, text in known.items() if text == number(least)]
    others = [f"{name} {text}" for name, text in known.items() if name not in best]
    if not others:
        return ""
    return f"{words} {' and '.join(best)} with {number(least)} {unit} ({', '.join(others)})."


def _view(run: RunView) -> HandView | None:
    """Return the view of a run's first hand with estimates, None without any."""
    return next((view for view in run.hands.values() if view.errors_mm), None)


def _differences(names: list[str], differences: Differences) -> str:
    if not differences.fields:
        return "<p>Nothing.</p>"
    rows = [(path, *values) for path, values in differences.fields.items()]
    columns: tuple[Column | str, ...] = ("field", *(Column(name, words=True) for name in names))
    return Table("Fields that are not equal in all runs", columns, rows).html()


def _runs(runs: Mapping[str, RunView]) -> str:
    facts = ("folder", "scenario", "mode", "source", "seed", "duration, s", "active estimator", "command")
    rows = []
    for name, run in runs.items():
        s = run.summary
        about = (s.scenario, s.mode, s.source, f"{s.seed}", f"{s.duration_s:.4g}", s.active_estimator)
        rows.append((name, str(run.logs.run_dir), *about, s.command or "-"))
    columns: tuple[Column | str, ...] = ("run", *(Column(fact, words=fact not in _NUMBERS) for fact in facts))
    return Table("Where the figures come from", columns, rows).html()


_SAME: Final = 0.005
Values = Sequence[float | None]
Difference = Callable[[float, float], str]


def in_percent(first: float, value: float) -> str:
    """Return a relative change in per cent; the change itself when the first value is 0."""
    if not first:
        return f"{value - first:+.3g}"
    share = value / first - 1
    return "\u00b10 %" if abs(share) < _SAME else f"{100 * share:+.0f} %"


def in_points(first: float, value: float) -> str:
    """Return a change in percentage points: from 1.0 % to 1.2 % is 0.2 points, not 20 %."""
    points = value - first
    return "\u00b10 points" if abs(points) < _SAME else f"{points:+.{1 if abs(points) >= 10 else 2}f} points"


def in_number(first: float, value: float) -> str:
    """Return the change of a count."""
    return f"{value - first:+g}"


class _Row(NamedTuple):
    """A row: its figure in a summary, and the form of its difference."""

    value: Callable[[Summary], float | None]
    difference: Difference = in_percent


_ROWS: Final[dict[str, _Row]] = {
    "end-to-end latency, median, ms": _Row(lambda s: s.latency_ms.end_to_end["p50"]),
    "end-to-end latency, p99, ms": _Row(lambda s: s.latency_ms.end_to_end["p99"]),
    "network's part, median, ms": _Row(lambda s: s.latency_ms.network["p50"]),
    "wait for the tick, median, ms": _Row(lambda s: s.latency_ms.tick_wait["p50"]),
    "round trip, median, ms": _Row(lambda s: s.latency_ms.round_trip["p50"]),
    "age at the tick, max, ms": _Row(lambda s: s.age_ms["max"]),
    "age at the tick, p95, ms": _Row(lambda s: s.age_ms["p95"]),
    "packets/s sent by the surgeon": _Row(lambda s: s.redundancy.price.packets_per_s),
    "kB/s sent by the surgeon": _Row(lambda s: kilo(s.redundancy.price.bytes_per_s)),
    "samples that never arrived, %": _Row(lambda s: s.redundancy.lost.samples_pct, in_points),
    "packets lost forward, %": _Row(lambda s: s.links["forward"].loss_pct, in_points),
    "packets lost back, %": _Row(lambda s: s.links["feedback"].loss_pct, in_points),
    "longest run of losses forward": _Row(lambda s: s.links["forward"].loss_runs.longest, in_number),
    "ticks missed by the patient": _Row(lambda s: s.ticks.missed, in_number),
}


def figure_tables(names: Sequence[str], runs: Sequence[RunView]) -> str:
    """Return a column for each run, with the difference to the first run where both have the figure."""
    figures = {
        title: ([value(run.summary) for run in runs], difference) for title, (value, difference) in _ROWS.items()
    }
    rows = [(title, *compared(*one)) for title, one in (figures | _accuracy(runs)).items()]
    text = (
        "In brackets the difference to the first run: in percentage points for shares, as a number "
        "for counts, else in per cent of the first run's figure. End to end: from the newest sample behind an "
        "estimate to its publication"
    )
    judged = [("a valid measurement", *("yes" if run.summary.valid else "no" for run in runs))]
    judged += [(title, *outcomes) for title, outcomes in _outcomes(runs).items()]
    words = [Column(name, words=True) for name in names]
    return (
        Table("Key figures, and the difference to the first run", ("figure", *names), rows, text).html()
        + Table("Validity, and requirements of applications", ("requirements", *words), judged).html()
    )


def compared(values: Values, difference: Difference) -> list[str]:
    """Return figures as text, each but the first with its difference to the first if both are known."""
    first = values[0]
    return [number(first), *(f"{number(value)}{_difference(first, value, difference)}" for value in values[1:])]


def _difference(first: float | None, value: float | None, difference: Difference) -> str:
    if first is None or value is None:
        return ""
    return " (same)" if value == first else f" ({difference(first, value)})"


def _accuracy(runs: Sequence[RunView]) -> dict[str, tuple[Values, Difference]]:
    """Return the errors of each hand's estimators in any of the runs, active ones first."""
    found = [run.summary.scores_by_hand for run in runs]
    hands = dict.fromkeys(hand for one in found for hand in one)
    active = dict.fromkeys(run.scenario.active_estimator for run in runs)
    others = dict.fromkeys(name for one in found for scores in one.values() for name in scores)
    rows: dict[str, tuple[Values, Difference]] = {}
    for hand in hands:
        for name in active | others:
            errors = [_score(one.get(hand, {}), name, "rmse_3d_mm") for one in found]
            if any(error is not None for error in errors):
                rows[f"RMSE of {name} in 3D, {hand} hand, mm"] = errors, in_percent
        for name in active:
            ratios = [_score(one.get(hand, {}), name, "ratio_to_hold") for one in found]
            shares = [None if ratio is None else 100 * ratio for ratio in ratios]
            rows[f"RMSE of {name} in 3D, {hand} hand, % of hold"] = shares, in_points
    return rows


def _outcomes(runs: Sequence[RunView]) -> dict[str, list[str]]:
    found = [{v.title: v.outcome_text(run.summary.ticks.rate_hz) for v in run.summary.verdicts} for run in runs]
    titles = dict.fromkeys(title for one in found for title in one)
    return {title: [one.get(title, "-") for one in found] for title in titles}


def _score(scores: Mapping[str, Scores], name: str, figure: str) -> float | None:
    found: float | None = scores[name][figure] if name in scores else None
    return found
