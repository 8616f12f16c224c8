"""Outcome of a run, from how the processes of its three sides ended."""

import signal
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, get_args

from tis.common.channels import Side
from tis.common.errors import EXIT_INTERRUPTED, EXIT_OK, PeerError

Event = dict[str, Any]


@dataclass(frozen=True)
class SideEnd:
    """End of a side's process: its exit code, negative for a signal, and what it said.

    ``signalled``: it was ended from here, so its exit code says nothing.
    """

    side: Side
    exit_code: int
    reasons: Sequence[str] = ()
    signalled: bool = False


@dataclass(frozen=True)
class Outcome:
    """End of a run: the command's exit code, its reasons, and each side's exit code."""

    exit_code: int
    reasons: tuple[str, ...]
    exit_codes: dict[Side, int]


def reasons_of(events: Sequence[Event], last_lines: Sequence[str]) -> list[str]:
    """Return the reported reasons of a failure, else the last lines of output, else the last counters."""
    failed = next((event for event in events if event["event"] == "failed"), None)
    if failed is not None:
        return [str(reason) for reason in failed["reasons"]]
    if last_lines:
        return list(last_lines)
    last = next((event for event in reversed(events) if event["event"] == "progress"), None)
    if last is None:
        return []
    counts = ", ".join(f"{name} {n}" for name, n in last["counters"].items() if n)
    return [f"at {last['now_s']:.1f} s: {counts}"]


def outcome_of(ends: Mapping[Side, SideEnd], interrupted: bool) -> Outcome:
    """Return the outcome: the most specific cause first."""
    codes = {side: end.exit_code for side, end in ends.items()}
    if interrupted:
        return Outcome(EXIT_INTERRUPTED, ("interrupted",), codes)
    failed = [ends[side] for side in get_args(Side) if side in ends and _failed(ends[side])]
    if not failed:
        return Outcome(EXIT_OK, (), codes)
    # Signals come first among the reasons: the other sides fail only because a peer has gone.
    killed = [end for end in failed if end.exit_code < 0]
    reasons: list[str] = []
    for end in killed:
        output = "; ".join(end.reasons) or "none"
        reasons.append(f"{end.side}: killed by {_signal_name(-end.exit_code)}, last output: {output}")
    # netem stands between the others, and knows best who left: to each of them it is netem that goes.
    for end in sorted(failed, key=lambda end: end.side != "netem"):
        reasons += [reason for reason in end.reasons if end not in killed and reason not in reasons]
    if killed:
        return Outcome(PeerError.exit_code, tuple(reasons), codes)
    # A side's own failure outranks the timeouts and broken sessions that it causes at its peers.
    own = [end.exit_code for end in failed if end.exit_code != PeerError.exit_code]
    return Outcome(
        own[0] if own else PeerError.exit_code, tuple(reasons) or ("a side failed without giving a reason",), codes
    )


def _failed(end: SideEnd) -> bool:
    return end.exit_code != EXIT_OK and not end.signalled


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:  # from another host
        return f"signal {number}"
