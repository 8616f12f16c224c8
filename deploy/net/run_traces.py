"""What netem did in a run, as traces: for each key when its messages were offered and how late they left."""

from dataclasses import replace
from pathlib import Path
from typing import Final, get_args

import numpy as np
from numpy.typing import NDArray

from common.channels import Direction
from common.errors import DataError, Fault
from common.trace import LOST, Trace
from deploy import run_dir as folder
from deploy.logs.choice import log_file
from deploy.report.read.batches import DELIVER, RELEASED, Fates, Releases, by_key, link_fates, link_releases
from deploy.report.read.load import Ints, RunLogs, load_side

_LOG: Final = "netem.mcap"


def run_traces(run_dir: Path) -> dict[Direction, Trace]:
    """Return one trace for each direction that has messages: that of its busiest key; raises `DataError`.

    The delay is the realised one, between netem's ingress and egress, of the original and not of copies. What was
    still held when the log ended is left out: nobody knows. In a run of the testbed only its own messages count;
    where netem stood between other applications, all do.
    """
    path = log_file(run_dir, "netem")
    if not path.is_file():
        raise DataError(Fault(str(run_dir), "", f"is no run folder with a log of netem ({_LOG})"))
    log = load_side(path, "netem")
    logs = RunLogs(run_dir, {"netem": log})
    with_foreign = folder.SCENARIO_FILE not in log.attachments
    found: dict[Direction, Trace] = {}
    for direction in get_args(Direction):
        traces = _traces(path, link_fates(logs, direction), link_releases(logs, direction), with_foreign)
        if traces:
            busiest = max(traces, key=lambda trace: len(trace.sent_ns))
            lack = log.coverage.problem
            found[direction] = busiest if lack is None else replace(busiest, about={"lack": lack})
    if not found:
        whose = "messages" if with_foreign else "messages of the testbed"
        raise DataError(Fault(str(path), "", f"must have {whose} that netem delivered"))
    return found


def _traces(path: Path, fates: Fates, releases: Releases, with_foreign: bool) -> list[Trace]:
    """Return a trace for each key that had a message delivered; foreign messages are keys of their own."""
    found = []
    for foreign in (False, True) if with_foreign else (False,):
        offered, left = fates.at(fates.foreign == foreign), releases.at(releases.foreign == foreign)
        left_of = dict(zip(left.keys, by_key(left.key, len(left.keys)), strict=True))
        for key, which in zip(offered.keys, by_key(offered.key, len(offered.keys)), strict=True):
            trace = _trace(f"{path}: {key}", offered.at(which), left.at(left_of.get(key, which[:0])))
            if trace is not None:
                found.append(trace)
    return found


def _trace(label: str, fates: Fates, releases: Releases) -> Trace | None:
    left = releases.at(releases.copy_index == 0)
    which = _places(fates, left)
    delivered = fates.outcome == DELIVER
    known = ~delivered | (which >= 0)  # the rest was held when the log ended
    through = delivered & (which >= 0)
    through[through] = left.departure[which[through]] == RELEASED
    if not through.any():
        return None
    delay_ns = np.full(len(fates.seq), LOST, dtype=np.int64)
    delay_ns[through] = np.maximum(left.released_ns[which[through]] - fates.offered_ns[through], 0)
    sent_ns, delay_ns = fates.offered_ns[known], delay_ns[known]
    order = np.argsort(sent_ns, kind="stable")
    return Trace(label, sent_ns[order] - sent_ns[order[0]], delay_ns[order])


def _places(fates: Fates, left: Releases) -> NDArray[np.int64]:
    """Return where in ``left`` each packet is, (N,); -1: nowhere. A number may come again when a sender restarts."""
    both = np.concatenate([_named(left.seq, left.offered_ns), _named(fates.seq, fates.offered_ns)])
    _, name = np.unique(both, axis=0, return_inverse=True)
    name = name.reshape(-1)
    place = np.full(len(both), -1, dtype=np.int64)
    place[name[: len(left.seq)]] = np.arange(len(left.seq))
    return np.asarray(place[name[len(left.seq) :]])


def _named(seq: Ints, offered_ns: Ints) -> NDArray[np.int64]:
    return np.stack([seq, offered_ns], axis=1)
