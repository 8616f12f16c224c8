"""The summary's ``verdicts``: the run against the requirements of applications and the scenario's own limits.

Their shape is `tis.common.metrics.verdict.SetVerdict`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Direction
from tis.common.metrics.verdict import (
    UNKNOWN,
    Finding,
    Judgement,
    Outcome,
    SetVerdict,
    combined,
    judge_loss,
    judge_percentile,
    judge_rms,
)
from tis.common.scenario.limits import REQUIREMENTS, Limits, Metric, Requirement
from tis.deploy.report.verdict.amounts import (
    COUNTED,
    limit_text,
    needed_count,
    needed_time,
    percentile_name,
    plain_number,
)

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
}
_UNITS: Final[dict[Metric, str]] = {"loss": "%", "rmse_3d": "mm"}


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
    decidable. Oracle: runs written by hand, tests/deploy/report/verdict/test_requirements.
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
    binding = [one for one in findings if one["binding"]]
    outcome = combined([one["outcome"] for one in binding])
    return {
        "name": name,
        "title": title,
        "source": source,
        "outcome": outcome,
        "line": f"{title}: {_line(outcome, binding, over_s, each=name == 'own')}",
        "findings": findings,
    }


def _finding(required: Requirement, measured: Measured | None, over_s: float | None) -> Finding:
    judgement = UNKNOWN if measured is None else _judge(required, measured)
    known = measured is not None and judgement.value is not None
    title = ", ".join(filter(None, (_NAMES[required.metric], required.direction)))
    unit = _UNITS.get(required.metric, "ms")
    uncertainty = measured.known_to if known and measured is not None else None
    aside = measured.aside if known and measured is not None else ""
    return {
        "metric": required.metric,
        "direction": required.direction,
        "title": title,
        "binding": required.binding,
        "unit": unit,
        "limit": required.limit,
        "percentile": required.percentile,
        **judgement._asdict(),  # type: ignore[typeddict-item]  # the names are the same
        "uncertainty": uncertainty,
        "aside": aside,
        "sentence": f"{title}: {_sentence(required, judgement, unit, uncertainty or 0.0, over_s)}{_remark(aside)}",
    }


def _judge(required: Requirement, measured: Measured) -> Judgement:
    if required.metric == "loss":
        return judge_loss(measured.values.astype(np.bool_), required.limit)
    values = measured.values.astype(np.float64)
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
    margin = f" \u00b1 {plain_number(uncertainty)}" if uncertainty else ""
    amount = f"{plain_number(value)}{margin} {unit}"
    if required.percentile is None:
        found = f"{amount} of {judgement.n} {of}"
    else:
        found = f"{required.percentile:g} % of {judgement.n} {of} within {amount}"
    if required.metric == "rmse_3d":
        found = f"{amount} over {judgement.n} {of}"
    if judgement.outcome == "met":
        return f"{found}, {allowed}: met"
    if judgement.excess is not None:
        over = "points" if unit == "%" else unit
        return f"{found}, {allowed}: {plain_number(judgement.excess)} {over} too much"
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
    missed, open_, met = ([one for one in binding if one["outcome"] == o] for o in ("missed", "not_decidable", "met"))
    missed.sort(key=_excess_ratio, reverse=True)
    parts = [
        f"{one['title']}{', ' if one['percentile'] else ' '}{_value_and_limit(one)}"
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
    amount = (
        f"{plain_number(finding['value'] or 0.0)} {finding['unit']}, {limit_text(finding['limit'], finding['unit'])}"
    )
    statistic = percentile_name(finding["percentile"])
    return (f"{statistic} {amount}" if statistic else amount) + _remark(finding["aside"])


def _remark(aside: str) -> str:
    return f", {aside}" if aside else ""


def _names(some: Sequence[Finding], of: Sequence[Finding]) -> str:
    """Return the names of some findings, without direction where both directions are among them."""
    others = {one["metric"] for one in of if one not in some}
    titles = [one["title"].replace(", ", " ") if one["metric"] in others else _base(one) for one in some]
    return ", ".join(dict.fromkeys(titles))


def _base(finding: Finding) -> str:
    return finding["title"].partition(",")[0]


def _needed_to_decide(open_: Sequence[Finding], over_s: float | None) -> list[str]:
    """Return the number of values that decides every open finding; empty where no number would."""
    short = [(one["n_needed"], one["n"], one["metric"]) for one in open_ if one["n_needed"]]
    if not short:
        return []
    # the finding that is furthest from a decision
    n_needed, n, metric = max(short, key=lambda one: one[0] / max(one[1], 1))
    return [f"{needed_count(n_needed, metric)} would tell{needed_time(n_needed, n, over_s)}"]


def _excess_ratio(finding: Finding) -> float:
    limit, value = finding["limit"], finding["value"]
    return (value or 0.0) / limit if limit else float("inf")
