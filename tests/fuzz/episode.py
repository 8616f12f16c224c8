"""An episode of fuzzing a side: what it counts, and the log that its records go to."""

import random
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from tests.fuzz.scratch_folder import scratch_folder
from tis.common.channels import Side
from tis.common.messages import Header, Message, decode, encode
from tis.common.node import Emission, Output, Record
from tis.common.runtime.mcap_log import McapLog
from tis.common.runtime.side_log import LOG_VERSION
from tis.deploy.logs.read.load import load_side

_FOLDER = scratch_folder()


@dataclass
class Episode:
    """A run of one side under fire: ``n_used`` are honest messages that it used, ``last`` what it was given last."""

    rng: random.Random
    n_messages: int = 0
    n_used: int = 0
    last: str = ""

    def given(self, key: str, payload: bytes, attachment: bytes = b"") -> None:
        """Note a message before it is handed over."""
        self.n_messages += 1
        self.last = f"{key} {payload[:400]!r} attachment {attachment[:40].hex()}"


class Log:
    """The real log of a side; at the end it is read back as the summary of a run reads it."""

    def __init__(self, side: Side) -> None:
        self.side: Side = side
        self.path: Path = _FOLDER / f"{side}.mcap"
        self.path.unlink(missing_ok=True)
        about = {"version": LOG_VERSION, "scenario": "fuzz", "digest": "0", "mode": "live", "side": side}
        self.log = McapLog(self.path, about)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.log.close()

    def take(self, outputs: Iterable[Output], now_ns: int) -> list[Output]:
        """Log what a node returns, and send what it sends; return it."""
        found = []
        for output in outputs:
            found.append(output)
            if isinstance(output, Record):
                self.keep(output)
            else:
                _sent(output, now_ns)
                for record in output.on_sent(now_ns):
                    self.keep(record)
        return found

    def keep(self, record: Record) -> None:
        """Log a record; raises `DecodeError` where a reader would refuse it, as with a number that is not finite."""
        if isinstance(record.data, Message):
            decode(encode(record.data), type(record.data))
        elif record.schema is not None:
            decode(record.data, record.schema)
        self.log.record(record)

    def read_back(self) -> None:
        """Close the log, and read it."""
        self.log.close()
        load_side(self.path, self.side)


def _sent(emission: Emission, now_ns: int) -> None:
    """Put the header on a message as the buses do."""
    if isinstance(emission.attachment, Header):
        emission.attachment._replace(sent_ns=now_ns, run_id=1).pack()
