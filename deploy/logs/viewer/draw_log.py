"""Log lines for viewers: control requests, estimator faults, rejected messages."""

from collections.abc import Iterator
from typing import Final

from tis.common.channels import Side
from tis.deploy.logs.json_rows import json_row
from tis.deploy.logs.topics import LOG
from tis.deploy.logs.viewer import foxglove
from tis.deploy.logs.viewer.drawn import Drawn, Records

_MAX_REJECTED: Final = 20


def line(at_ns: int, level: foxglove.Level, name: str, text: str) -> Drawn:
    """Return a line of the log as a message."""
    return Drawn(LOG, "log", at_ns, foxglove.log_line(at_ns, level, name, text))


class ControlStream:
    """Changes of the network."""

    def take(self, records: Records) -> Iterator[Drawn]:
        """Yield a line for each request, with the reason of a refusal."""
        for at_ns, payload in zip(records.log_ns.tolist(), records.payloads, strict=True):
            row = json_row(payload)
            text = f"{row['operation']} {row['request']}"
            if row["accepted"]:
                yield line(at_ns, "INFO", "netem", text)
            else:
                yield line(at_ns, "WARNING", "netem", f"refused ({row['reason']}): {text}")


class FaultStream:
    """The first failures of user-defined estimators."""

    def take(self, records: Records) -> Iterator[Drawn]:
        """Yield a line for each."""
        for at_ns, payload in zip(records.log_ns.tolist(), records.payloads, strict=True):
            row = json_row(payload)
            text = f"{row['estimator']} failed, {row['hand']} hand: {row['reason']}; further times are counted"
            yield line(at_ns, "WARNING", "patient", text)


class RejectedStream:
    """Messages that a side rejected, the first ones only."""

    def __init__(self, side: Side) -> None:
        self._side, self._n_seen = side, 0

    def take(self, records: Records) -> Iterator[Drawn]:
        """Yield a line for each of the first messages."""
        for at_ns, payload in zip(records.log_ns.tolist(), records.payloads, strict=True):
            self._n_seen += 1
            if self._n_seen <= _MAX_REJECTED:
                row = json_row(payload)
                last = "; further ones are not listed here" if self._n_seen == _MAX_REJECTED else ""
                yield line(at_ns, "WARNING", self._side, f"rejected on {row['key']}: {row['reason']}{last}")
