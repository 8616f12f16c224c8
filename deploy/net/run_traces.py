"""What netem did in a run, as traces: for each key when its messages were offered and how late they left."""

from collections import defaultdict
from pathlib import Path
from typing import Final, get_args

import numpy as np

from common.channels import Direction
from common.errors import DataError, Fault
from common.records import FATES, RELEASES
from common.trace import LOST, Trace
from deploy.report.load import Row, load_side

_LOG: Final = "netem.mcap"


def run_traces(run_dir: Path) -> dict[Direction, Trace]:
    """Return one trace for each direction that has messages: that of its busiest key; raises `DataError`.

    The delay is the realised one, between netem's ingress and egress, of the original and not of copies. What was
    still held when the log ended is left out: nobody knows.
    """
    path = run_dir / _LOG
    if not path.is_file():
        raise DataError(Fault(str(run_dir), "", f"is no run folder with a log of netem ({_LOG})"))
    log = load_side(path, "netem")
    found: dict[Direction, Trace] = {}
    for direction in get_args(Direction):
        fates = _by_key(log.of(FATES), direction)
        releases = _by_key(log.of(RELEASES), direction)
        traces = {key: _trace(f"{path}: {key}", rows, releases.get(key, [])) for key, rows in fates.items()}
        known = {key: trace for key, trace in traces.items() if trace is not None}
        if known:
            found[direction] = max(known.values(), key=lambda trace: len(trace.sent_ns))
    if not found:
        raise DataError(Fault(str(path), "", "must have messages that netem delivered"))
    return found


def _by_key(rows: list[Row], direction: Direction) -> dict[str, list[Row]]:
    batches: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        if row["direction"] == direction and not row["foreign"]:
            batches[row["key"]].append(row)
    return batches


def _trace(label: str, fates: list[Row], releases: list[Row]) -> Trace | None:
    left_ns = {
        seq: released_ns  # 0 where it was dropped after all
        for batch in releases
        for seq, copy, released_ns in zip(batch["seq"], batch["copy_index"], batch["released_ns"], strict=True)
        if copy == 0
    }
    sent: list[int] = []
    delays: list[int] = []
    for batch in fates:
        for seq, offered_ns, outcome in zip(batch["seq"], batch["offered_ns"], batch["outcome"], strict=True):
            if outcome == "deliver" and seq not in left_ns:
                continue
            released_ns = left_ns.get(seq, 0) if outcome == "deliver" else 0
            sent.append(offered_ns)
            delays.append(released_ns - offered_ns if released_ns > 0 else LOST)
    order = np.argsort(np.array(sent, dtype=np.int64), kind="stable")
    sent_ns, delay_ns = np.array(sent, dtype=np.int64)[order], np.array(delays, dtype=np.int64)[order]
    if not len(sent_ns) or not np.any(delay_ns != LOST):
        return None
    return Trace(label, sent_ns - sent_ns[0], np.where(delay_ns == LOST, LOST, np.maximum(delay_ns, 0)))
