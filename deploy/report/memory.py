"""A log in memory: the columns of a run without files, for commands that run many."""

from collections import defaultdict

from pydantic import BaseModel
from pydantic_core import from_json

from common.channels import Side
from common.node import Record
from deploy.report.load import Row, SideLog


class MemoryLog:
    """Takes a side's records as a file log does; ``log`` is what `deploy.report.load.load_side` would read back.

    Oracle: the same twin with files (tests/deploy/report/test_memory).
    """

    def __init__(self, side: Side) -> None:
        rows: dict[str, list[Row]] = defaultdict(list)
        self.log = SideLog(side, None, {}, {}, rows)

    def record(self, record: Record) -> None:
        """Keep one record."""
        self.log.n_messages += 1
        self.log.last_ns = max(self.log.last_ns, record.log_ns)
        data = record.data
        row: Row = data.model_dump() if isinstance(data, BaseModel) else from_json(data)
        if not record.topic.startswith("/"):
            sent_ns = record.log_ns if record.publish_ns is None else record.publish_ns
            row["_seq"], row["_sent_ns"], row["_log_ns"] = record.seq, sent_ns, record.log_ns
        self.log.rows[record.topic].append(row)
