"""Log in memory: columns of a run without files, for commands with many runs."""

from pydantic import BaseModel
from pydantic_core import from_json

from common.channels import Side
from common.node import Record
from deploy.logs.read.side_columns import SideLog


class MemoryLog:
    """Takes a side's records like a log file; ``log`` equals what `deploy.logs.read.load.load_side` would return.

    Oracle: the same twin with files (tests/deploy/logs/read/test_memory).
    """

    def __init__(self, side: Side) -> None:
        self.log = SideLog(side, {}, {}, {})

    def record(self, record: Record) -> None:
        """Keep one record."""
        data = record.data
        row = data.model_dump() if isinstance(data, BaseModel) else from_json(data)
        sent_ns = record.log_ns if record.publish_ns is None else record.publish_ns
        self.log.add(record.topic, row, record.seq, sent_ns, record.log_ns)
