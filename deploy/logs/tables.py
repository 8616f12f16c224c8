"""A run's records as tables: named columns of equal length, for any file format."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from common.channels import Hand
from common.records import ESTIMATES, FRESH, PLANT, PROMPT
from common.units import MM_PER_M
from deploy.report.batches import DEPARTURES, OUTCOMES, Fates, Releases
from deploy.report.load import RunLogs
from deploy.report.rows import Row, Rows
from deploy.report.run_data import Run

Table = dict[str, NDArray[Any]]

_AXES: Final = "xyz"
_OF_COLUMNS: Final[Mapping[str, str]] = {PLANT: "plant", FRESH: "fresh", PROMPT: "prompt_estimates"}


def tables(run: Run) -> Iterator[tuple[str, Table]]:
    """Yield each table's name and columns; those without a row are left out.

    Instants are run time in ns by netem's clock, positions in m. Oracle: the logs' own records
    (tests/deploy/logs/test_export).
    """
    found = {
        "tracks": _stacked([_track(run, hand) for hand in run.tracks]),
        "truth": _stacked(
            [{**_same("hand", hand, len(at.sample_ns)), **_flat(at._asdict())} for hand, at in run.truth.items()]
        ),
        "ticks": _stacked([{**_same("side", side, len(at.tick)), **at._asdict()} for side, at in run.ticks.items()]),
        "ages": _stacked([{**_same("hand", hand, len(at.t_ns)), **at._asdict()} for hand, at in run.ages.items()]),
        "messages": _stacked(
            [
                {**_same("side", side, len(at.seq)), **_same("key", key, len(at.seq)), **at._asdict()}
                for side, keys in run.messages.items()
                for key, at in keys.items()
            ]
        ),
        "fates": _stacked([_packets(way, books, "outcome", OUTCOMES) for way, books in run.fates.items()]),
        "releases": _stacked([_packets(way, books, "departure", DEPARTURES) for way, books in run.releases.items()]),
        **dict(_records(run.logs)),
    }
    yield from ((name, table) for name, table in found.items() if table and len(next(iter(table.values()))))


def _track(run: Run, hand: Hand) -> Table:
    track = run.tracks[hand]
    table = {**_same("hand", hand, len(track.t_ns)), "t_ns": track.t_ns, "scored": track.scored}
    table |= _flat({"truth_m": track.truth_m})
    for name, position_m in track.estimates.items():
        table |= _flat({f"{name}_m": position_m})
        table[f"{name}_error_mm"] = MM_PER_M * np.linalg.norm(position_m - track.truth_m, axis=1)
    return table


def _packets(direction: str, books: Fates | Releases, coded: str, names: Sequence[str]) -> Table:
    table = {**_same("direction", direction, len(books.seq)), **books._asdict()}
    table["key"] = np.array([*books.keys, ""], dtype=np.str_)[books.key]
    table[coded] = np.array(names, dtype=np.str_)[table[coded]]
    del table["keys"]
    return table


def _records(logs: RunLogs) -> Iterator[tuple[str, Table]]:
    """Yield the records that have no table of their own, by side and topic; estimates all in one."""
    estimates = []
    for side, log in logs.sides.items():
        for topic, rows in log.rows.items():
            if isinstance(rows, Rows):
                columns = _flat({name: rows.column(name) for name in rows.names})
                if topic.startswith(f"{ESTIMATES}/"):
                    estimates.append(columns)
                elif topic in _OF_COLUMNS:
                    yield _OF_COLUMNS[topic], columns
            else:
                name = f"{side}_{topic.removeprefix('/tis/').replace('/', '_')}"
                yield name, _of_rows(rows)
    yield "estimates", _stacked(estimates)


def _of_rows(rows: Sequence[Row]) -> Table:
    """Return the fields of rows that hold single values; what is missing in some is empty text."""
    names = dict.fromkeys(name for row in rows for name, value in row.items() if not isinstance(value, list | dict))
    return {name: np.array(["" if row.get(name) is None else row[name] for row in rows]) for name in names}


def _flat(columns: Mapping[str, NDArray[Any]]) -> Table:
    """Return the columns with (N, 3) ones as three: ``position_m`` becomes ``position_x_m`` and so on."""
    table: Table = {}
    for name, values in columns.items():
        if values.ndim == 1:
            table[name] = values
            continue
        for i, axis in enumerate(_AXES):
            table[f"{name.removesuffix('_m')}_{axis}_m"] = values[:, i]
    return table


def _same(name: str, value: str, n: int) -> Table:
    return {name: np.full(n, value)}


def _stacked(parts: Sequence[Table]) -> Table:
    """Return tables one below the other; where one has no such column it is NaN."""
    names = dict.fromkeys(name for part in parts for name in part)
    return {name: np.concatenate([_or_nan(part, name) for part in parts]) for name in names}


def _or_nan(part: Table, name: str) -> NDArray[Any]:
    return part[name] if name in part else np.full(len(next(iter(part.values()))), np.nan)
