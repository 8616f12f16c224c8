"""Poses from trajectories in text: of the TUM RGB-D benchmark, and of the EuRoC MAV dataset.

TUM: ``timestamp tx ty tz qx qy qz qw``, in s and m, https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats.
EuRoC: ``#timestamp [ns], p_RS_R_x [m], ..., q_RS_w [], ...``, w first, and what is not read: Burri et al., "The EuRoC
micro aerial vehicle datasets", 2016, DOI 10.1177/0278364915620033. Both are the poses of a body in a fixed frame.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from functools import partial
from pathlib import Path
from typing import Final

from tis.common.errors import MAX_SHOWN, DataError, Fault, capped
from tis.common.runtime.recordings.table_file import decoded
from tis.deploy.recordings_import.choice import streams_of
from tis.deploy.recordings_import.found import DEVICES, Found, Rows, Wanted
from tis.deploy.recordings_import.messages import Read

_NAN: Final = float("nan")
_MAX_NS: Final = 1 << 63


@dataclass(frozen=True)
class Form:
    """A form of lines: cells in each, decimals of the instants that make ns, and the places of x y z qx qy qz qw."""

    name: str
    n_cells: int
    digits_of_ns: int
    places: Sequence[int]

    def read(self, cells: Sequence[str]) -> Read:
        """Return what a line's cells hold; raises `ValueError`."""
        if len(cells) != self.n_cells:
            raise ValueError("another number of cells")
        try:
            t_ns = Decimal(cells[0]).scaleb(self.digits_of_ns)
            is_instant = abs(t_ns) < _MAX_NS
        except ArithmeticError:
            is_instant = False
        if not is_instant:
            raise ValueError("no instant")
        pose = [float(cells[place]) for place in self.places]
        return int(t_ns), (*pose, *[_NAN] * (8 - len(pose))), True


_TUM: Final = Form("tum", 8, 9, range(1, 8))
_EUROC: Final = re.compile(r"([pq])_\w+?_([wxyz])(?: \[.*\])?")


def form_of(text: str) -> Form | None:
    """Return the form of a trajectory's text by its first line, or its first numbers; None if it is none."""
    lines = text.splitlines()
    first = lines[0] if lines else ""
    if first.lower().startswith("#timestamp"):
        names = [cell.strip() for cell in first.split(",")]
        named = [_EUROC.fullmatch(name) for name in names]
        places = {f"{found[1]}{found[2]}": k for k, found in enumerate(named) if found is not None}
        pose = [places.get(part, -1) for part in ("px", "py", "pz", "qx", "qy", "qz", "qw")]
        if -1 not in pose[:3]:
            return Form("euroc", len(names), 0, pose if -1 not in pose else pose[:3])
    rows = (line.split() for line in lines if line.strip() and not line.startswith("#"))
    return _TUM if len(next(rows, ())) == _TUM.n_cells else None


def read_trajectory(file: Path, text: str, form: Form, wanted: Wanted) -> Found:
    """Return the poses as those of the left master, which moves the arm.

    Raises `DataError` with the lines that hold no pose, unless they are skipped, and as `streams_of` does. Oracle:
    files that the tests write.
    """
    rows, faults = Rows(True), list[Fault]()
    rule = f"must hold {form.n_cells} numbers, as a line of {form.name} has"
    for number, line in enumerate(text.splitlines(), 1):
        cells = line.partition("#")[0].replace(",", " ").split()
        if not cells:
            continue
        n_before = rows.n_undecodable
        rows.take(partial(form.read, cells))
        if n_before < rows.n_undecodable <= MAX_SHOWN:
            faults.append(Fault(str(file), f"line {number}", rule, line[:60]))
    if faults and not wanted.skips_unreadable:
        raise DataError(capped(faults, rows.n_undecodable, str(file), rule, "lines"))
    origin = f"poses of {form.name}"
    streams, _, notes = streams_of({DEVICES[0]: origin}, {}, {origin: rows}, str(file), wanted.skips_unreadable)
    return Found(streams, (), (f"{origin} -> poses of {DEVICES[0]}", *notes), {"kind": form.name})


def text_of(file: Path) -> str:
    """Return the text of a file; raises `DataError` for one that cannot be read."""
    try:
        return decoded(file)
    except OSError as error:
        raise DataError(Fault(str(file), "", f"cannot be read: {error.strerror or error}")) from None
