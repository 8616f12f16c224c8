"""Requirements of applications, and the scenario's own limits: the verdict on each, and why."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Direction
from tis.common.metrics.verdict import (
    UNKNOWN,
    Judgement,
    Obstacle,
    Outcome,
    combined,
    judge_loss,
    judge_maximum,
    judge_percentile,
    judge_rms,
)
from tis.common.scenario.limits import MAXIMA, REQUIREMENTS, Limits, Metric, Requirement
from tis.deploy.present.numbers import percentile_name, rounded_count, rounded_span, significant
from tis.deploy.report.section import Section, means


class Finding(Section):
    """The verdict on one requirement."""

    metric: str = means("Figure that is judged.")
    direction: str | None = means("Link that it is of; `null` for none.")
    title: str = means("Its name for people.")
    binding: bool = means("True when it decides the verdict; false for a recommendation.")
    unit: str = means("Unit of value and limit.")
    limit: float = means("Largest value allowed.")
    percentile: float | None = means("Percentile that is judged; `null` for a share or a mean.")
    outcome: Outcome = means("`met`, `missed` or `not_decidable`.")
    value: float | None = means("Value found.")
    excess: float | None = means("How far it exceeds the limit.")
    n: int = means("Observations.")
    n_outside: int | None = means("Observations beyond the limit.")
    n_needed: int | None = means("Observations that a decision takes; `null` when there were enough.")
    obstacle: Obstacle | None = means("Reason for which it is not decidable.")
    uncertainty: float | None = means("Bound of the error that the clocks leave in the value.")
    aside: str = means("Remark on the finding.")
    sentence: str = means("The finding in a sentence.")


class SetVerdict(Section):
    """The verdict on a set of requirements: missed if a binding finding is, else not decidable if one is not."""

    name: str = means("Set of requirements; `own` for the scenario's `limits`.")
    title: str = means("Its name for people.")
    source: str = means("Publication that the requirements are from.")
    outcome: Outcome = means("`met`, `missed` or `not_decidable`.")
    line: str = means("The verdict in a line.")
    findings: list[Finding] = means("The verdict on each requirement.")

    def outcome_text(self, rate_hz: int) -> str:
        """Return the outcome in words: "out of reach" where it is missed and allows less time than a tick takes."""
        at_a_tick = [one.limit for one in self.findings if one.binding and one.metric in _AT_A_TICK]
        if self.outcome == "missed" and min(at_a_tick, default=float("inf")) < _MS_PER_S / rate_hz:
            return OUT_OF_REACH
        return self.outcome.replace("_", " ")


def split_by_reach(verdicts: Sequence[SetVerdict], rate_hz: int) -> tuple[list[SetVerdict], str]:
    """Return the verdicts that a run at this rate can pass, and in a line the others, "" without any."""
    near = [one for one in verdicts if one.outcome_text(rate_hz) != OUT_OF_REACH]
    far = ", ".join(one.title for one in verdicts if one not in near)
    return near, far and f"{far}: they allow less than the {_MS_PER_S / rate_hz:.3g} ms between ticks"


OUT_OF_REACH: Final = "out of reach"
_AT_A_TICK: Final = ("end_to_end", "age", "round_trip")
_MS_PER_S: Final = 1000
COUNTED: Final[dict[str, str]] = {
    "one_way": "messages",
    "pdv": "messages",
    "loss": "messages",
    "end_to_end": "estimates with a new sample",
    "round_trip": "round trips",
    "network_round_trip": "round trips",
    "age": "ticks",
    "rmse_3d": "ticks",
    "contact": "ticks",
    "energy": "ticks",
    "hand_to_eye": "pictures",
    "freeze": "runs",
}
"""Unit of counting of each metric of `tis.common.scenario.limits`: it has one value for each."""


def limit_text(value: float, unit: str) -> str:
    """Return a limit in words, unrounded."""
    return f"allowed {significant(value, 6)} {unit}"


def needed_count(n_needed: int, metric: str) -> str:
    """Return the number of values needed in all."""
    return f"about {rounded_count(n_needed)} {COUNTED[metric]}"


def needed_time(n_needed: int, n: int, over_s: float | None) -> str:
    """Return the time that they take at the rate of ``n`` in ``over_s``; "" when it is unknown."""
    return f", {rounded_span(n_needed * over_s / n)} at this rate" if over_s and n else ""


Floats = NDArray[np.float64]
_NAMES: Final[dict[Metric, str]] = {
    "one_way": "one way",
    "end_to_end": "end to end",
    "round_trip": "round trip",
    "network_round_trip": "the network's round trip",
    "pdv": "delay variation",
    "age": "age at the ticks",
    "loss": "loss",
    "rmse_3d": "RMSE in 3D",
    "contact": "force of contact",
    "energy": "energy given to the hand",
    "hand_to_eye": "hand to eye",
    "freeze": "time in which the picture stands still",
}
_UNITS: Final[dict[Metric, str]] = {"loss": "%", "rmse_3d": "mm", "contact": "N", "energy": "mJ", "freeze": "%"}


@dataclass(frozen=True)
class Measured:
    """Measured values of one metric, (N,) in its unit; for `loss`, whether each message was lost.

    ``uncertainty`` bounds the common clock error of the values, (N,) or one for all; inf when it is unbounded.
    ``aside`` is a remark for readers; it does not affect the verdict.
    """

    values: Floats | NDArray[np.bool_]
    uncertainty: Floats | float = 0.0
    aside: str = ""

    @property
    def known_to(self) -> float | None:
        """Return the largest uncertainty, None when it is unbounded."""
        largest = float(np.max(self.uncertainty, initial=0.0))
        return largest if np.isfinite(largest) else None


def verdicts(
    measured: Mapping[tuple[Metric, Direction | None], Measured], limits: Limits, over_s: float | None = None
) -> list[SetVerdict]:
    """Return the verdict on each set of requirements, the scenario's own limits first.

    ``over_s`` is the duration of the measurement, None if unknown. A metric without an entry in ``measured`` is not
    decidable. Oracle: runs written by hand, tests/deploy/report/subjects/test_requirements.
    """
    found = []
    own = limits.requirements()
    if own:
        source = "limits of the scenario" + (f", with the preset {limits.preset}" if limits.preset else "")
        found.append(_judged("own", "the scenario's limits", source, own, measured, over_s))
    for name, wanted in REQUIREMENTS.items():
        found.append(_judged(name, wanted.title, wanted.source, wanted.requirements, measured, over_s))
    return found


def _judged(
    name: str,
    title: str,
    source: str,
    requirements: Sequence[Requirement],
    measured: Mapping[tuple[Metric, Direction | None], Measured],
    over_s: float | None,
) -> SetVerdict:
    findings = [_finding(one, measured.get((one.metric, one.direction)), over_s) for one in requirements]
    binding = [one for one in findings if one.binding]
    outcome = combined([one.outcome for one in binding])
    return SetVerdict(
        name=name,
        title=title,
        source=source,
        outcome=outcome,
        line=f"{title}: {_line(outcome, binding, over_s, each=name == 'own')}",
        findings=findings,
    )


def _finding(required: Requirement, measured: Measured | None, over_s: float | None) -> Finding:
    judgement = UNKNOWN if measured is None else _judge(required, measured)
    known = measured is not None and judgement.value is not None
    title = ", ".join(filter(None, (_NAMES[required.metric], required.direction)))
    unit = _UNITS.get(required.metric, "ms")
    uncertainty = measured.known_to if known and measured is not None else None
    aside = measured.aside if known and measured is not None else ""
    return Finding(
        metric=required.metric,
        direction=required.direction,
        title=title,
        binding=required.binding,
        unit=unit,
        limit=required.limit,
        percentile=required.percentile,
        **judgement._asdict(),
        uncertainty=uncertainty,
        aside=aside,
        sentence=f"{title}: {_sentence(required, judgement, unit, uncertainty or 0.0, over_s)}{_remark(aside)}",
    )


def _judge(required: Requirement, measured: Measured) -> Judgement:
    if required.metric == "loss":
        return judge_loss(measured.values.astype(np.bool_), required.limit)
    values = measured.values.astype(np.float64)
    if required.metric in MAXIMA:
        return judge_maximum(values, required.limit)
    if required.percentile is None:
        return judge_rms(values, required.limit)
    return judge_percentile(values, required.percentile, required.limit, measured.uncertainty)


def _sentence(
    required: Requirement, judgement: Judgement, unit: str, uncertainty: float, over_s: float | None
) -> str:
    """Return the measured value, the limit, and the excess or the number of values needed to decide."""
    value, allowed = judgement.value, limit_text(required.limit, unit)
    if value is None:
        return f"not measured, {allowed}"
    of = COUNTED[required.metric]
    margin = f" \u00b1 {significant(uncertainty)}" if uncertainty else ""
    amount = f"{significant(value)}{margin} {unit}"
    if required.percentile is None:
        found = f"{amount} of {judgement.n} {of}"
    else:
        found = f"{required.percentile:g} % of {judgement.n} {of} within {amount}"
    if required.metric == "rmse_3d" or required.metric in MAXIMA:
        found = f"{amount} over {judgement.n} {of}"
    if required.metric == "freeze":
        found = f"{amount} of the time"
    if judgement.outcome == "met":
        return f"{found}, {allowed}: met"
    if judgement.excess is not None:
        over = "points" if unit == "%" else unit
        return f"{found}, {allowed}: {significant(judgement.excess)} {over} too much"
    if judgement.obstacle == "clock":
        return f"{found}, {allowed}: not decidable, the clocks are not known well enough"
    if judgement.n_needed is None:
        return f"{found}, {allowed}: not decidable with so few {of}, no number would do"
    enough = needed_count(judgement.n_needed, required.metric) + needed_time(judgement.n_needed, judgement.n, over_s)
    return f"{found}, {allowed}: not decidable with so few {of}, it takes {enough}"


def _line(outcome: Outcome, binding: Sequence[Finding], over_s: float | None, each: bool) -> str:
    """Return the outcome with the worst miss, or else with the number of values needed to decide.

    ``each``: name every requirement; misses come first and in full, then undecidable ones, then those met.
    """
    missed, open_, met = ([one for one in binding if one.outcome == o] for o in ("missed", "not_decidable", "met"))
    missed.sort(key=_excess_ratio, reverse=True)
    parts = [
        f"{one.title}{', ' if one.percentile else ' '}{_value_and_limit(one)}"
        for one in (missed if each else missed[:1])
    ]
    if len(missed) > len(parts):
        parts.append(f"{len(missed) - len(parts)} more missed")
    if open_ and (each or not missed):
        parts += [f"{'not decidable: ' if missed else ''}{_names(open_, binding)}", *_needed_to_decide(open_, over_s)]
    if met and each:
        parts.append(f"{'met: ' if len(met) < len(binding) else ''}{_names(met, binding)}")
    word = outcome.replace("_", " ")
    return f"{word} ({'; '.join(parts)})" if parts else word


def _value_and_limit(finding: Finding) -> str:
    amount = f"{significant(finding.value or 0.0)} {finding.unit}, {limit_text(finding.limit, finding.unit)}"
    statistic = percentile_name(finding.percentile)
    return (f"{statistic} {amount}" if statistic else amount) + _remark(finding.aside)


def _remark(aside: str) -> str:
    return f", {aside}" if aside else ""


def _names(some: Sequence[Finding], of: Sequence[Finding]) -> str:
    """Return the names of some findings, without direction where both directions are among them."""
    others = {one.metric for one in of if one not in some}
    titles = [one.title.replace(", ", " ") if one.metric in others else _base(one) for one in some]
    return ", ".join(dict.fromkeys(titles))


def _base(finding: Finding) -> str:
    return finding.title.partition(",")[0]


def _needed_to_decide(open_: Sequence[Finding], over_s: float | None) -> list[str]:
    """Return the number of values that decides every open finding; empty where no number would."""
    short = [(one.n_needed, one.n, one.metric) for one in open_ if one.n_needed]
    if not short:
        return []
    # the finding that is furthest from a decision
    n_needed, n, metric = max(short, key=lambda one: one[0] / max(one[1], 1))
    return [f"{needed_count(n_needed, metric)} would tell{needed_time(n_needed, n, over_s)}"]


def _excess_ratio(finding: Finding) -> float:
    limit, value = finding.limit, finding.value
    return (value or 0.0) / limit if limit else float("inf")
