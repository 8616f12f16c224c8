"""Outages of a run, changes of its network while it ran, and sides that were away: what to know before any figure."""

from collections.abc import Mapping, Sequence
from typing import Final, Literal, NamedTuple, get_args

from msgspec import convert

from tis.common.channels import Direction, Side
from tis.common.records import CONTROL, ControlNote
from tis.common.units import NS_PER_S
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.present.numbers import counted
from tis.deploy.report.subjects.network.requested import NetworkRequest, Requested
from tis.netem.control.replay import MadeChange, made_changes

_MAX_NAMED: Final = 3


class Disturbance(NamedTuple):
    """An outage, a stall or another change of the network, or the absence of a ``side`` until it was started anew.

    ``live``: somebody caused it while the run went on. ``what`` a change set, in words; ``lasts``: to the run's end.
    """

    begin_s: float
    end_s: float
    kind: Literal["outage", "stall", "change", "absence"]
    direction: Literal["forward", "feedback", "both"]
    live: bool
    side: Side | None = None
    what: str = ""
    lasts: bool = False

    def __str__(self) -> str:
        """Return the disturbance in words, with its begin and length in run time."""
        where = self.side or ("both directions" if self.direction == "both" else self.direction)
        length = f"{self.end_s - self.begin_s:.3g} s"
        if self.kind == "change":
            during = "to the end" if self.lasts else f"for {length}"
            return f"from {self.begin_s:.2f} s {during}, {where}: {self.what}"
        return f"{self.kind} of {length} at {self.begin_s:.2f} s, {where}"


def disturbances(logs: RunLogs, scenario: NetworkRequest) -> list[Disturbance]:
    """Return outages and stalls, planned ones too, live changes and absences of sides, by their begin.

    What holds in both directions at the same time is one. Without netem's log only absences are known. Oracle: a run
    with a planned and a live outage, test_disturbances.
    """
    log = logs.sides.get("netem")
    away = [
        Disturbance(begin_ns / NS_PER_S, end_ns / NS_PER_S, "absence", "both", True, side)
        for side, one in logs.sides.items()
        for begin_ns, end_ns in one.coverage.away
    ]
    if log is None:
        return away
    made = made_changes(convert(row, ControlNote) for row in logs.of("netem", CONTROL))
    found: dict[tuple[float, float], dict[Direction, Disturbance]] = {}
    for direction in get_args(Direction):
        of_it = [one for one in made if one.direction in (direction, "both")]
        for one in _of_direction(Requested.of(scenario, direction, logs), direction, log.last_ns, of_it):
            found.setdefault((one.begin_s, one.end_s), {})[direction] = one
    of_network = [
        one._replace(direction="both") if len(each) == len(get_args(Direction)) and _alike(each) else one
        for _, each in sorted(found.items())
        for one in (list(each.values())[:1] if _alike(each) else each.values())
    ]
    return sorted([*of_network, *away], key=lambda one: (one.begin_s, one.end_s))


def _alike(each: Mapping[Direction, Disturbance]) -> bool:
    return len({(one.kind, one.live, one.what) for one in each.values()}) == 1


def _of_direction(
    request: Requested, direction: Direction, last_ns: int, made: Sequence[MadeChange]
) -> list[Disturbance]:
    stretches = [(begin_ns, min(end_ns, last_ns)) for begin_ns, end_ns in request.changed if begin_ns < last_ns]
    found, outages = [], []
    for span in request.spans(last_ns):
        if span.outage or span.stall:
            live = any(begin_ns <= span.begin_ns < end_ns for begin_ns, end_ns in stretches)
            outages.append((span.begin_ns, span.end_ns))
            kind: Literal["outage", "stall"] = "outage" if span.outage else "stall"
            found.append(_disturbance(span.begin_ns, span.end_ns, kind, direction, live))
    # a live outage is in the list of outages already
    for begin_ns, end_ns in stretches:
        if (begin_ns, end_ns) not in outages:
            what = "; then ".join(one.what for one in made if begin_ns <= one.begin_ns < end_ns)
            changed = _disturbance(begin_ns, end_ns, "change", direction, True)
            found.append(changed._replace(what=what, lasts=end_ns == last_ns))
    return found


def _disturbance(
    begin_ns: int, end_ns: int, kind: Literal["outage", "stall", "change"], direction: Direction, live: bool
) -> Disturbance:
    return Disturbance(begin_ns / NS_PER_S, end_ns / NS_PER_S, kind, direction, live)


def disturbances_text(name: str, found: Sequence[Disturbance]) -> str:
    """Return a sentence on a run's live changes and one each on its planned outages and stalls; "" without any."""
    live = [one for one in found if one.live and one.side is None]
    parts = []
    if away := [one for one in found if one.side is not None]:
        parts.append(f"Of {name} a side was away until it was started anew: {_listed(away)}.")
    if live:
        parts.append(f"Somebody changed the network of {name} while it ran: {_listed(live)}.")
    for kind in ("outage", "stall"):
        planned = [one for one in found if not one.live and one.kind == kind]
        total_s = sum(one.end_s - one.begin_s for one in planned)
        if planned:
            parts.append(f"{name} had {counted(len(planned), f'planned {kind}')}, {total_s:.3g} s in all.")
    return " ".join(parts)


def _listed(found: Sequence[Disturbance]) -> str:
    """Return the weightiest in order of time, outages before others, longer ones first; then how many more."""
    kept = sorted(found, key=lambda one: (one.kind != "outage", one.begin_s - one.end_s))[:_MAX_NAMED]
    left = len(found) - len(kept)
    return "; ".join(str(one) for one in found if one in kept) + (f"; and {left} more" if left > 0 else "")
