"""Validity of a run as a measurement: its faults, beside damaged logs and books that do not balance."""

from operator import itemgetter
from typing import Final

from tis.common.channels import Side
from tis.common.errors import EXIT_INTERRUPTED, problem
from tis.common.metrics.tracking import SETTLING_NS
from tis.common.records import PEERS, UNRECORDED
from tis.common.scenario import Scenario
from tis.common.sources.plausibility import FAR
from tis.common.units import NS_PER_S
from tis.deploy.logs.payloads import Row
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.report.subjects.accuracy import is_scored, slow_estimators, without_estimate
from tis.deploy.report.subjects.devices import is_foreign, silent_camera, silent_programs
from tis.deploy.report.subjects.intrusion import evidence_problems, quarantine_texts
from tis.deploy.report.subjects.latency import sent_after_arrival
from tis.deploy.report.subjects.logs import counters_of
from tis.deploy.report.subjects.network.link_ends import refused_arrivals
from tis.deploy.report.subjects.processors import contention_clause, shares_of
from tis.deploy.report.subjects.ticks import Ticks
from tis.deploy.report.summary import Summary

_LIVES: Final = {
    "left": ("{peer} left", "its last words say why"),
    "frozen": ("{peer} stood still ({seconds:.1f} s)", "do not suspend its process, and free a core"),
    "link_down": (
        "{peer} could not be reached: nothing crossed the network between the hosts",
        "check cables and firewall",
    ),
    "silent": ("{peer} was silent", "its own log may say why"),
    "stalled": (
        "{peer} did not tick: its loop stayed in one step{step}",
        "make the estimator or the arm that it names faster",
    ),
    "clock_step": ("{peer}'s clock stepped by {seconds:+.1f} s", "let chrony slew the clock instead"),
    "suspended": ("{peer}'s host was suspended ({seconds:.1f} s)", "disable sleep there"),
}
"""What makes a run invalid of what the sides noticed of each other, in words, and what to do about it."""
_OWN_CAUSES: Final = {
    "clock_step": "its clock stepped",
    "suspended": "its host was suspended",
    "frozen": "it stood still",
    "stalled": "its loop stayed in one step",
}
_UNPLANNED: Final = "Zenoh dropped them outside netem, where a queue was full: send less, or make its queues larger"
_NOT_USED: Final = "these are the messages that the patient did not use"
_UNITS: Final = {
    "": "positions in mm that were taken for m would be as far",
    "table": "positions in mm that were taken for m would be as far: if they are, set source.units.position: mm",
}
_AGAIN: Final = "its last words say why; then run it again"
_MAX_NOTICED: Final = 200
_SAME_NS: Final = 2 * NS_PER_S
_MAX_MISSED_TICKS: Final = 0.01
_MAX_UNPLANNED: Final = 0.01
MAX_UNUSED: Final = 0.01


def _unused(summary: Summary, source: str = "") -> list[str]:
    """Return a problem where the patient did not use messages that it lacked: what causes the problems below.

    Junk of strangers beside a whole stream does no harm, and is none. ``source`` is the kind of the movement.
    """
    link = summary.links["forward"]
    few = MAX_UNUSED * (link.sent or 0)
    if is_scored(summary.accuracy) and (link.unplanned_loss or 0) + (link.not_used or 0) <= few:
        return []
    problems = []
    rejected = summary.rejected.get("patient") or 0
    if rejected > few:
        why = "no header of the testbed, another run's number, or no such pose"
        cure = "end the other run or program that sends on these keys"
        problems.append(problem(f"rejected: the patient rejected {rejected} messages: {why}", cure))
    if sum(n or 0 for n in summary.quarantined.values()) > few:
        is_far = summary.recording is not None and any(FAR in text for text in summary.recording.warnings)
        texts = quarantine_texts(summary.quarantined, _UNITS.get(source, _UNITS[""]) if is_far else None)
        problems += [f"quarantined: {text}" for text in texts]
    return problems


def _lives(logs: RunLogs) -> list[str]:
    """Return a problem for each side that left, stood still, could not be reached or had a clock that stepped.

    What several sides noticed of one within two seconds is one problem, of the side that knows best: it itself, its
    neighbour, then any other.
    """
    each = ((side, row) for side in logs.sides for row in logs.of(side, PEERS) if not _came_back(logs, row))
    noticed = sorted(((row["at_ns"], side, row) for side, row in each if row["event"] in _LIVES), key=itemgetter(0))
    told: list[tuple[int, Side, Row]] = []
    for at_ns, side, row in noticed[:_MAX_NOTICED]:
        known = next((i for i, one in enumerate(told) if _is_same(one, at_ns, row)), None)
        if known is None:
            told.append((at_ns, side, row))
        elif _knows_better(side, row, told[known]):
            told[known] = (told[known][0], side, row)
    return [_life_text(*one) for one in told]


def _came_back(logs: RunLogs, row: Row) -> bool:
    """Tell whether a side left and was started anew: the gap between the parts of its log says so."""
    covered = logs.coverage(row["peer"])
    spans = () if covered is None else covered.away
    return row["event"] in ("left", "silent", "frozen") and any(
        begin <= row["at_ns"] <= end + _SAME_NS for begin, end in spans
    )


def _unrecorded(logs: RunLogs) -> list[str]:
    """Return a problem for each log that lacks records which its side could not write in time."""
    problems = []
    for side in logs.sides:
        prefix, counts = f"{UNRECORDED}.", counters_of(logs, side)
        lacking = {name.removeprefix(prefix): n for name, n in counts.items() if name.startswith(prefix)}
        if lacking:
            most = ", ".join(f"{n} of {topic}" for topic, n in sorted(lacking.items(), key=lambda one: -one[1])[:3])
            text = f"{side}'s log lacks {sum(lacking.values())} records, written too slowly: {most}"
            problems.append(problem(text, "give a folder on a faster disk, by --run-dir"))
    return problems


def _is_same(told: tuple[int, Side, Row], at_ns: int, row: Row) -> bool:
    return bool(told[2]["peer"] == row["peer"]) and at_ns - told[0] < _SAME_NS + max(row["for_ns"], 0)


def _knows_better(side: Side, row: Row, told: tuple[int, Side, Row]) -> bool:
    """Tell whether a side knows better than the one that was told; a link that is down is the better reason."""
    _, by, known = told
    if side == row["peer"] and by != row["peer"]:
        return True
    return bool(row["event"] == "link_down" and known["event"] in ("frozen", "silent") and by != row["peer"])


def _life_text(at_ns: int, side: Side, row: Row) -> str:
    """Return what ``side`` noticed at an instant, and who it was."""
    step = f" ({row['doing']})" if row["doing"] else ""
    words, cure = _LIVES[row["event"]]
    text = words.format(peer=row["peer"], seconds=row["for_ns"] / NS_PER_S, step=step)
    noticed = f"as {'it itself' if side == row['peer'] else side} noticed"
    return problem(f"{text} at {at_ns / NS_PER_S:.1f} s, {noticed}", cure)


def _starved(summary: Summary, scenario: Scenario, logs: RunLogs, unused: bool) -> list[str]:
    """Return the problems of a run that was starved, ended early, lost messages outside netem or has no score.

    ``unused``: the patient did not use messages, which is another problem, and the cause of these.
    """
    problems = []
    owners: tuple[tuple[str, Side, Ticks, str], ...] = (
        ("ticks", "patient", summary.ticks, "the run ended early"),
        ("surgeon_ticks", "surgeon", summary.surgeon_ticks, "the surgeon ended early"),
    )
    may_end = scenario.source.kind == "live" and summary.exit == EXIT_INTERRUPTED  # nobody drives for a planned time
    for name, side, ticks, early in owners:
        count, planned, covered = ticks.count, ticks.planned, logs.coverage(side)
        if count is None or count >= planned:
            continue
        if may_end and (covered is None or covered.whole):
            continue
        if covered is None or covered.whole or covered.away:
            problems.append(problem(f"{name}: {count} of {planned} happened, {early}", _AGAIN))
        else:
            cure = "tis recover copies what can be read of a damaged log"
            problems.append(problem(f"{name}: the log tells of {count} of {planned}", cure))
    for name, side, ticks, _ in owners:
        missed, count = ticks.missed or 0, ticks.count
        if count is not None and missed > _MAX_MISSED_TICKS * count:
            slow = slow_estimators(summary.accuracy, len(summary.scores_by_hand), scenario.rate_hz)
            why, cure = _why_missed(logs, side, slow if side == "patient" else "")
            problems.append(problem(f"{name}: {missed} of {count} missed, {why}", cure))
    for direction, link in summary.links.items():
        unplanned, sent = link.unplanned_loss, link.sent
        if unplanned is not None and sent is not None and unplanned > _MAX_UNPLANNED * sent:
            text = f"links.{direction}: {unplanned} of {sent} lost that nobody planned{_while_away(logs)}"
            is_told = unused and direction == "forward"
            problems.append(problem(text, _NOT_USED if is_told else _UNPLANNED))
    if not is_scored(summary.accuracy):
        text = f"accuracy: no tick could be scored: {why_unscored(logs, scenario)}"
        cure = "let more pass by the network, or make duration_s longer"
        problems.append(problem(text, "see why it refused them" if unused else cure))
    return problems


def _while_away(logs: RunLogs) -> str:
    """Return a clause that names the sides that were started anew and whose absence counts; "" without any."""
    counted = [side for side in logs.sides if (found := logs.coverage(side)) and found.away and found.away_counts]
    return f", with {' and '.join(counted)} away for a while" if counted else ""


def _why_missed(logs: RunLogs, side: Side, slow: str = "") -> tuple[str, str]:
    """Return why ticks were missed, and the cure: the side was away or stood still, or the machine was busy.

    ``slow`` tells of estimators that alone take longer than a tick.
    """
    if side == "surgeon" and is_foreign(logs):
        return "as the foreign surgeon sent no such sample in time that could be used", "let it send earlier"
    covered = logs.coverage(side)
    if covered is not None and covered.away and covered.away_counts:
        return "as it was started anew in mid-run (on_rejoin)", "on_rejoin: exclude leaves that time out"
    of_side = [(one, row["event"]) for one in logs.sides for row in logs.of(one, PEERS) if row["peer"] == side]
    told = {event for by, event in of_side if by == side or event == "stalled"}  # a side knows best of itself
    for event, words in _OWN_CAUSES.items():
        if event in told:
            return f"as {words}", _LIVES[event][1]
    if slow:
        return slow, "make it faster, leave it out, or lower rate_hz; in tis twin time is virtual"
    cure = "free the processors, or use tis twin, whose time is virtual"
    return f"the machine is too busy{contention_clause(shares_of(logs, side), side)}", cure


def why_unscored(logs: RunLogs, scenario: Scenario) -> str:
    """Return the reason why no tick is scored."""
    arrivals = logs.messages("patient", "forward", scenario.session).values()
    first_ns = min((int(one.log_ns.min()) for one in arrivals if len(one)), default=None)
    if first_ns is None:
        refused = refused_arrivals(logs, "forward", scenario.session).values()
        if n_refused := sum(len(each) for each in refused):
            return f"the patient's gate refused all {n_refused} messages that reached it"
        return "no message is known to have reached the patient"
    first_s, settling_s = first_ns / NS_PER_S, SETTLING_NS / NS_PER_S
    if scenario.duration_s <= first_s + settling_s:
        return (
            f"ticks count from {settling_s:g} s after the first arrival (at {first_s:.3f} s), when filters have "
            f"settled, and the run lasts {scenario.duration_s:g} s"
        )
    return "there is no tick at which both the truth and hold's estimate are known"


def invalidities(summary: Summary, scenario: Scenario, logs: RunLogs) -> list[str]:
    """Return a sentence for each problem that the figures of a summary show."""
    unused = _unused(summary, scenario.source.kind)
    return [
        *_lives(logs),
        *unused,
        *silent_programs(summary.devices, summary.external_arms),
        *silent_camera(summary.external_camera),
        *sent_after_arrival(summary.latency_ms, summary.uncertainty_ms),
        *_unrecorded(logs),
        *_starved(summary, scenario, logs, bool(unused)),
        *without_estimate(summary.accuracy, summary.active_estimator, summary.own_estimators),
        *evidence_problems(summary.evidence, scenario),
    ]


def validity_text(summary: Summary, since: str | None = None) -> str:
    """Return the sentence on validity; a colon at its end announces the problems.

    Valid: the logs are complete, their packet counts balance and no process was starved, so the figures are what
    happened. Faithful: what happened is the network of the scenario. A run may be one without the other. ``since``
    names damage to the logs after the summary was written; the sentence is then in the past tense.
    """
    if not summary.valid:
        return "This run is not a valid measurement:"
    unlike = [name for name, link in summary.links.items() if link.verdict.faithful is False]
    is_one = f"Before {since} this run was a valid measurement" if since else "This run is a valid measurement"
    count = summary.ticks.count or 0
    if summary.exit == EXIT_INTERRUPTED and count < summary.ticks.planned:  # only a drive is valid then
        is_one += f" of the {summary.duration_s:.1f} s until Ctrl-C ended it, as it may end a drive"
    if not unlike:
        return f"{is_one}."
    return (
        f"{is_one}, but not of the network that the scenario requests "
        f"({' and '.join(unlike)}): its figures hold for the network that there was."
    )
