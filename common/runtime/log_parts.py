"""Parts of a side's log: ``SIDE.mcap``, and ``SIDE_2.mcap``, ``SIDE_3.mcap``, ... after restarts in the same run."""

import os
import struct
from itertools import takewhile
from pathlib import Path
from typing import Final, NamedTuple

from mcap.exceptions import McapError
from mcap.records import Attachment, Metadata
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from tis.common.channels import Side
from tis.common.units import NS_PER_S

CLOCK_FILE: Final = "clock.json"
_MAX_PARTS: Final = 100
_MAX_STAMP_NS: Final = 1 << 62
_MAX_RECORDS: Final = 50
"""Attachments and metadata stand at a log's beginning, before the first chunk."""


class PartClock(BaseModel):
    """Time base of one part of a log, and the run that it belongs to, as attached to it."""

    model_config = ConfigDict(frozen=True)

    epoch_monotonic_ns: int = Field(ge=-_MAX_STAMP_NS, le=_MAX_STAMP_NS)
    """The side's monotonic clock at run time 0."""
    epoch_unix_ns: int = Field(ge=-_MAX_STAMP_NS, le=_MAX_STAMP_NS)
    """The host's calendar clock at run time 0, since 1970."""
    real_time: int = 0
    run_id: int | None = None
    boot: str = ""
    """`boot_digest` of the side's host."""
    joined_ns: int | None = Field(None, ge=0, le=_MAX_STAMP_NS)
    """Run time from which this part holds the side's records; None: from the beginning."""
    counts_gap: bool = True
    """Whether the time without the side, before ``joined_ns``, counts in the figures."""


class EarlierPart(NamedTuple):
    """The last part of a side's log, which a restarted side continues."""

    path: Path
    digest: str
    clock: PartClock

    def is_under_way(self, digest: str, end_ns: int, now_unix_ns: int) -> bool:
        """Tell whether its run, of the scenario with this ``digest``, may still go on at ``now_unix_ns``."""
        return self.digest == digest and now_unix_ns < self.clock.epoch_unix_ns + end_ns + NS_PER_S

    def why_not_continued(self, run_id: int, boot: str) -> str | None:
        """Return why a log of the run ``run_id`` on this ``boot`` does not continue this part; None when it does."""
        if self.clock.run_id != run_id:
            return f"{self.path} is of another run than the one that the others are in"
        if self.clock.boot != boot:
            return f"{self.path} was written before this host was started anew, which set its clock back"
        return None

    @property
    def was_cut(self) -> bool:
        """Tell whether its process was killed: it did not write the log's end."""
        with self.path.open("rb") as file:
            file.seek(-min(len(MCAP0_MAGIC), self.path.stat().st_size), os.SEEK_END)
            return file.read() != MCAP0_MAGIC


def part_name(side: Side, number: int) -> str:
    """Return the file name of a part; the first has number 1."""
    return f"{side}.mcap" if number == 1 else f"{side}_{number}.mcap"


_COMPANIONS: Final[dict[Side, str]] = {"patient": "camera", "surgeon": "screen"}
"""What may run beside a side, in a process of its own (`tis.common.runtime.companion`)."""


def companion_name(side: Side, number: int) -> str:
    """Return the file name of the log of what runs beside a side; the first has number 1, others follow restarts."""
    name = f"{side}_{_COMPANIONS[side]}"
    return f"{name}.mcap" if number == 1 else f"{name}_{number}.mcap"


def companion_logs(run_dir: Path, side: Side) -> list[Path]:
    """Return the logs of what ran beside a side."""
    names = (companion_name(side, n + 1) for n in range(_MAX_PARTS if side in _COMPANIONS else 0))
    return list(takewhile(Path.exists, (run_dir / name for name in names)))


def n_parts(run_dir: Path, side: Side) -> int:
    """Return the number of parts of a side's log in a run folder, without gaps in their numbers."""
    return next((n for n in range(_MAX_PARTS) if not (run_dir / part_name(side, n + 1)).exists()), _MAX_PARTS)


def last_part(run_dir: Path, side: Side) -> EarlierPart | None:
    """Return the last part of a side's log that was in a run; None where there is none."""
    for number in range(n_parts(run_dir, side), 0, -1):
        path = run_dir / part_name(side, number)
        digest, clock = _head_of(path)
        if clock is not None:
            return EarlierPart(path, digest, clock)
    return None


def part_clock(attachments: dict[str, bytes]) -> PartClock | None:
    """Return the time base attached to a log; None where it is missing or unreadable."""
    return _parsed(attachments.get(CLOCK_FILE, b""))


def _head_of(path: Path) -> tuple[str, PartClock | None]:
    digest = ""
    try:
        with path.open("rb") as file:
            for number, record in enumerate(StreamReader(file, emit_chunks=True).records):
                if isinstance(record, Metadata) and record.name == "run":
                    digest = record.metadata.get("digest", "")
                if isinstance(record, Attachment) and record.name == CLOCK_FILE:
                    return digest, _parsed(record.data)
                if number > _MAX_RECORDS:
                    break
    except (OSError, McapError, ValueError, struct.error):  # killed before it had written them
        pass
    return digest, None


def _parsed(data: bytes) -> PartClock | None:
    try:
        return PartClock.model_validate_json(data)
    except ValidationError:
        return None
