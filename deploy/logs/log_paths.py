"""Paths of the sides' logs in a run folder, with the parts of restarted sides, and recovered logs."""

import struct
from itertools import count, takewhile
from pathlib import Path
from typing import BinaryIO, get_args

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Metadata
from mcap.writer import MCAP0_MAGIC

from tis.common.channels import Side
from tis.common.runtime.log_parts import part_name
from tis.deploy.logs.blocks import MAX_METADATA_BYTES, RecordContent, record_heads
from tis.deploy.logs.coverage import RECOVERED


def log_file(run_dir: Path, side: Side, part: int = 1) -> Path:
    """Return the file to read as a side's log, or as a later part of it; ``SIDE.mcap`` when there is none.

    ``SIDE_recovered.mcap`` replaces the damaged file that it was made from, also when that file is gone. A log that
    was fetched again since then has another size and is read itself. Oracle: folders made by hand,
    tests/deploy/logs/test_log_paths.
    """
    own = run_dir / part_name(side, part)
    recovered = recovered_name(own)
    entries = recovery_of(recovered)
    if entries is None or (own.exists() and str(own.stat().st_size) != entries.get("of_bytes")):
        return own
    return recovered


def log_files(run_dir: Path) -> dict[Side, tuple[Path, ...]]:
    """Return the files of each side that has a log in any state, parts in order (`tis.common.runtime.log_parts`)."""
    found: dict[Side, tuple[Path, ...]] = {side: _parts(run_dir, side) for side in get_args(Side)}
    return {side: paths for side, paths in found.items() if paths}


def _parts(run_dir: Path, side: Side) -> tuple[Path, ...]:
    each = (log_file(run_dir, side, part) for part in count(1))
    return tuple(takewhile(Path.exists, each))


def recovered_name(path: Path) -> Path:
    """Return the path of the recovered log of a log."""
    return path.parent / f"{path.stem}_recovered.mcap"


def recovery_of(path: Path) -> dict[str, str] | None:
    """Return the recovery metadata of a recovered log; None for any other file, or one that is incomplete."""
    if not path.is_file():
        return None
    try:
        with path.open("rb") as file:
            return _recovery_in(file, path.stat().st_size)
    except (McapError, OSError, ValueError, struct.error):
        return None


def _recovery_in(file: BinaryIO, n_bytes: int) -> dict[str, str] | None:
    found: dict[str, str] | None = None
    for opcode, length in record_heads(file, n_bytes):
        if opcode == Opcode.METADATA and length <= MAX_METADATA_BYTES:
            metadata = Metadata.read(RecordContent(file.read(length)))
            found = dict(metadata.metadata) if metadata.name == RECOVERED else found
        elif opcode == Opcode.FOOTER:
            file.seek(length, 1)
            return found if file.read(len(MCAP0_MAGIC)) == MCAP0_MAGIC else None
    return None
