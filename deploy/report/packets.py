"""What became of each message of a link, as columns to draw."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.channels import Direction
from common.records import FATES, RELEASES
from common.units import NS_PER_MS, NS_PER_S
from deploy.report.load import RunLogs

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LinkColumns:
    """One link's messages, from netem's log; those whose attachment is not ours are left out.

    ``sent_s`` (N,) is when each delivered one was offered, in s of run time, ``decided_ms`` (N,) the delay that the
    models drew and ``realised_ms`` (N,) the one that was measured. ``lost_s`` holds when the lost ones were offered.
    """

    sent_s: Array
    seq: NDArray[np.int64]
    decided_ms: Array
    realised_ms: Array
    lost_s: Array


def link_columns(logs: RunLogs, direction: Direction) -> LinkColumns:
    """Return one link's columns, in the order in which the messages were offered; empty without netem's log."""
    fates = [row for row in logs.of("netem", FATES) if row["direction"] == direction and not row["foreign"]]
    decided_ns = {(row["key"], row["seq"]): row["delay_ns"] for row in fates if row["outcome"] == "deliver"}
    lost_ns = [row["offered_ns"] for row in fates if row["outcome"] != "deliver"]
    through = []
    for row in logs.of("netem", RELEASES):
        drawn_ns = decided_ns.get((row["key"], row["seq"]))
        if row["direction"] != direction or row["foreign"] or drawn_ns is None:
            continue
        if row["late"]:
            lost_ns.append(row["offered_ns"])
        else:
            through.append((row["offered_ns"], row["seq"], drawn_ns, row["released_ns"] - row["offered_ns"]))
    columns = np.array(sorted(through), dtype=np.int64).reshape(-1, 4)
    return LinkColumns(
        sent_s=columns[:, 0] / NS_PER_S,
        seq=columns[:, 1],
        decided_ms=columns[:, 2] / NS_PER_MS,
        realised_ms=columns[:, 3] / NS_PER_MS,
        lost_s=np.sort(np.array(lost_ns, dtype=np.float64)) / NS_PER_S,
    )
