"""The summary's ``verdicts``: the run against what applications are said to need, and against one's own limits.

Their shape is `common.metrics.verdict.SetVerdict`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.channels import Direction
from common.metrics.verdict import (
    UNKNOWN,
    Finding,
    Judgement,
    Outcome,
    SetVerdict,
    judge_loss,
    judge_percentile,
    judge_rms,
    together,
)
from common.scenario.limits import Limits
from common.scenario.requirements import REQUIREMENTS, Metric, Requirement
from deploy.report.verdict.amounts import COUNTED, limit, needed_count, needed_time, percentile_name, plain

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
_WORDS: Final[dict[Outcome, str]] = {"met": "met", "missed": "missed", "not_decidable": "not decidable"}


@dataclass(frozen=True)
class Measured:
    """What a run measured of one metric: values (N,) in its unit, or for `loss` whether each message got lost.

    ``uncertainty`` is how far the values may be off together by the clocks, (N,) or one for all; inf: nobody knows.
    ``aside`` is what people must know to read the figure; it decides nothing.
    """

    values: Floats | NDArray[np.bool_]
    uncertainty: Floats | float = 0.0
    aside: str = ""

    @property
    def known_to(self) -> float | None:
        """Return the largest uncertainty, None where nothing bounds it."""
        largest = float(np.max(self.uncertainty, initial=0.0))
        return largest if np.isfinite(largest) else None


def verdicts(
    measured: Mapping[tuple[Metric, Direction | None], Measured], limits: Limits, over_s: float | None = None
) -> list[SetVerdict]:
    """Return the verdict on each set of requirements, one's own limits first where there are any.

    ``over_s`` is how long it took to measure, None where that is not known. What is not in ``measured`` is not
    decidable. Oracle: runs made by hand, tests/deploy/report/verdict/test_requirements.
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
    outcome = together([one["outcome"] for one in binding])
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
        "sentence": f"{title}: {_said(required, judgement, unit, uncertainty or 0.0, over_s)}{_after(aside)}",
    }


def _judge(required: Requirement, measured: Measured) -> Judgement:
    if required.metric == "loss":
        return judge_loss(measured.values.astype(np.bool_), required.limit)
    values = measured.values.astype(np.float64)
    if required.percentile is None:
        return judge_rms(values, required.limit)
    return judge_percentile(values, required.percentile, required.limit, measured.uncertainty)


def _said(required: Requirement, judgement: Judgement, unit: str, uncertainty: float, over_s: float | None) -> str:
    """Return what was found, what is allowed, and by how much it was missed or what it takes to decide."""
    value, allowed = judgement.value, limit(required.limit, unit)
    if value is None:
        return f"not measured, {allowed}"
    of = COUNTED[required.metric]
    give = f" \u00b1 {plain(uncertainty)}" if uncertainty else ""
    amount = f"{plain(value)}{give} {unit}"
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
        return f"{found}, {allowed}: {plain(judgement.excess)} {over} too much"
    if judgement.obstacle == "clock":
        return f"{found}, {allowed}: not decidable, the clocks are not known well enough"
    if judgement.n_needed is None:
        return f"{found}, {allowed}: not decidable with so few {of}, no number would do"
    enough = needed_count(judgement.n_needed, required.metric) + needed_time(judgement.n_needed, judgement.n, over_s)
    return f"{found}, {allowed}: not decidable with so few {of}, it takes {enough}"


def _line(outcome: Outcome, binding: Sequence[Finding], over_s: float | None, each: bool) -> str:
    """Return the outcome with the worst of what was missed, or else with what it takes to decide.

    ``each``: name every requirement, what was missed first and in full, then what is open, then what is met.
    """
    missed, open_, met = ([one for one in binding if one["outcome"] == o] for o in ("missed", "not_decidable", "met"))
    missed.sort(key=_times, reverse=True)
    parts = [
        f"{one['title']}{', ' if one['percentile'] else ' '}{_against(one)}"
        for one in (missed if each else missed[:1])
    ]
    if len(missed) > len(parts):
        parts.append(f"{len(missed) - len(parts)} more missed")
    if open_ and (each or not missed):
        parts += [f"{'not decidable: ' if missed else ''}{_names(open_, binding)}", *_needed_to_decide(open_, over_s)]
    if met and each:
        parts.append(f"{'met: ' if len(met) < len(binding) else ''}{_names(met, binding)}")
    return f"{_WORDS[outcome]} ({'; '.join(parts)})" if parts else _WORDS[outcome]


def _against(finding: Finding) -> str:
    """Return what was measured and what is allowed."""
    amount = f"{plain(finding['value'] or 0.0)} {finding['unit']}, {limit(finding['limit'], finding['unit'])}"
    statistic = percentile_name(finding["percentile"])
    return (f"{statistic} {amount}" if statistic else amount) + _after(finding["aside"])


def _after(aside: str) -> str:
    return f", {aside}" if aside else ""


def _names(some: Sequence[Finding], of: Sequence[Finding]) -> str:
    """Return the names of some findings: without a direction where those of both are among them."""
    others = {one["metric"] for one in of if one not in some}
    titles = [one["title"].replace(", ", " ") if one["metric"] in others else _base(one) for one in some]
    return ", ".join(dict.fromkeys(titles))


def _base(finding: Finding) -> str:
    return finding["title"].partition(",")[0]


def _needed_to_decide(open_: Sequence[Finding], over_s: float | None) -> list[str]:
    """Return how many more it takes to decide what takes most; nothing where no number would."""
    short = [(one["n_needed"], one["n"], one["metric"]) for one in open_ if one["n_needed"]]
    if not short:
        return []
    n_needed, n, metric = max(short, key=lambda one: one[0] / max(one[1], 1))
    return [f"{needed_count(n_needed, metric)} would tell{needed_time(n_needed, n, over_s)}"]


def _times(finding: Finding) -> float:
    most, value = finding["limit"], finding["value"]
    return (value or 0.0) / most if most else float("inf")
