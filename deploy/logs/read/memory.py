"""Log in memory: columns of a run without files, for commands with many runs."""

from pydantic import BaseModel

from tis.common.channels import Side
from tis.common.node import Record
from tis.deploy.logs.read.side_columns import SideLog


class MemoryLog:
    """Takes a side's records like a log file; ``log`` equals what `tis.deploy.logs.read.load.load_side` would return.

    Oracle: the same twin with files (tests/deploy/logs/read/test_memory).
    """

    def __init__(self, side: Side) -> None:
        self.log = SideLog(side, {}, {}, {})

    def record(self, record: Record) -> None:
        """Keep one record."""
        if isinstance(record.data, BaseModel):
            self.log.add(record.topic, record.data.model_dump(), record.log_ns)
        else:
            sent_ns = record.log_ns if record.publish_ns is None else record.publish_ns
            self.log.add_message(record.topic, record.data, record.seq, sent_ns, record.log_ns)
