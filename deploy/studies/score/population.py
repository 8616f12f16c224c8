"""The open track's movements: a synthetic population in tables, whose bytes are the same on every processor.

A function of the C library, or a vector unit, may change the last bit of a float. The tables hold whole nanometres,
whole nanoseconds and whole microradians, and no value of the protocol's population lies within 1e-15 m of the border
between two of them (`least_margin`), some five bits of a position: so the last bits decide nothing.
"""

import hashlib
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from tis.common.errors import DataError, Fault
from tis.common.scenario.source import SyntheticSource
from tis.common.sources.population import person, trial_seed
from tis.common.sources.synthetic import synthesise
from tis.common.sources.table_columns import TIME, canonical_names
from tis.common.sources.trajectory import Array, PoseTrack
from tis.common.streams import Stream
from tis.common.units import NS_PER_S
from tis.deploy.shell import run_dir as folder
from tis.deploy.studies.score.protocol import content, hashes

_GRID_HZ: Final = 500
_STEP_MS: Final = 1000 // _GRID_HZ
_NM: Final = 1e9
_URAD: Final = 1e6


class Group(NamedTuple):
    """Who is trained on or scored: people by their numbers, and the length of their movement."""

    indices: range
    duration_s: float

    @property
    def files(self) -> list[str]:
        """The names of their tables: a person is what stands before the first _."""
        return [f"P{index + 1:02d}_1.csv" for index in self.indices]


def trained() -> Group:
    """Return the people whose movements are trained on."""
    its = content()["tracks"]["open"]["trained"]
    return Group(range(its["people"]), its["duration_s"])


def scored(n_people: int | None = None) -> Group:
    """Return the people who are scored, all or the first ``n_people`` of them."""
    first, its = len(trained().indices), content()["tracks"]["open"]["scored"]
    return Group(range(first, first + (n_people or its["people"])), its["duration_s"])


def write(place: Path, data: str, group: Group, seed: int) -> list[Path]:
    """Write the tables of a group that are not there yet; return all of them.

    Raises `DataError` where a table of the protocol's seed is not the protocol's.
    """
    found = []
    for index, name in zip(group.indices, group.files, strict=True):
        file = place / data / name
        expected = hashes().get(f"{data}/{name}") if seed == content()["tracks"]["open"]["seed"] else None
        if not file.is_file() or (expected is not None and _sha256(file.read_bytes()) != expected):
            made = table(data, seed, index, group.duration_s).encode()
            if expected is not None and _sha256(made) != expected:
                rule = (
                    "is not the protocol's table: the arithmetic here makes another movement; report this processor"
                )
                raise DataError(Fault(f"{data}/{name}", "sha256", f"{rule}, must be {expected}", _sha256(made)))
            folder.made(file.parent)
            folder.write(file, made)
        found.append(file)
    return found


def table(data: str, seed: int, index: int, duration_s: float) -> str:
    """Return the table of a person as CSV: canonical columns, each row at its own instant."""
    at_ms, values = _values(data, seed, index, duration_s)
    heads = [TIME, *canonical_names("MTML"), *canonical_names("PSM2")]
    whole = np.rint(values).astype(np.int64)
    digits = [9, *([9, 9, 9, 6, 6, 6, 6, 6] * 2)]
    rows = np.column_stack([at_ms * (NS_PER_S // 1000), whole]).tolist()
    lines = [",".join(_decimal(value, n) for value, n in zip(row, digits, strict=True)) for row in rows]
    return "\n".join([",".join(heads), *lines]) + "\n"


def least_margin(data: str, seed: int, index: int, duration_s: float) -> float:
    """Return how near any value comes to the border between two that are written, in their unit: 0 to 0.5."""
    _, values = _values(data, seed, index, duration_s)
    return float(np.abs(values - np.floor(values) - 0.5).min())


def _values(data: str, seed: int, index: int, duration_s: float) -> tuple[Array, Array]:
    """Return the rows' instants (N,) in ms and the values (N, 16) in nm and microradians, not rounded."""
    its = content()["tracks"]["open"]
    rate_hz = content()["scenario"]["rate_hz"]
    source = SyntheticSource.model_validate({"kind": "synthetic", "hands": ("left",), **its["data"][data]})
    one = person(source, seed, index)
    n_rows = round(duration_s * rate_hz)
    steps = its["jitter_ms"] // _STEP_MS
    drawn = Stream.named(seed, f"protocol/{index}/jitter").uniforms(0, n_rows)
    beside = np.floor(drawn * (2 * steps + 1)).astype(np.int64) - steps
    beside[0] = 0  # stamps count from the first row
    at = np.maximum((2 * np.arange(n_rows) * _GRID_HZ + rate_hz) // (2 * rate_hz) + beside, 0)
    (hand,) = synthesise(one, trial_seed(seed, index, 1), _GRID_HZ, int(at[-1]) + 1, 0).hands
    return at * _STEP_MS, np.hstack([_scaled(hand.command, at), _scaled(hand.follower, at)])


def _scaled(track: PoseTrack, at: Array) -> Array:
    angles = np.column_stack([track.orientation[at], track.gripper_rad[at]])
    return np.hstack([track.position_m[at] * _NM, angles * _URAD])


def _decimal(value: int, n_digits: int) -> str:
    """Return a whole number of units as a decimal of ``n_digits`` places."""
    whole, part = divmod(abs(value), 10**n_digits)
    return f"{'-' if value < 0 else ''}{whole}.{part:0{n_digits}d}"


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
