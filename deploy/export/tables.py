"""Tables of a run's records: named columns of equal length, for any file format."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, Final, overload

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Direction, Hand, Side, is_predicted, is_set_point
from tis.common.records import ESTIMATES, FRESH, ORIENTATIONS, PLANT, PROMPT
from tis.common.scenario.estimator_names import plain_name
from tis.common.units import MM_PER_M
from tis.deploy.logs.json_rows import Row
from tis.deploy.logs.read.batches import DEPARTURES, OUTCOMES, Fates, Releases, fates_by_key, releases_by_key
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.rows import Rows
from tis.deploy.report.run_data import Run

Columns = dict[str, NDArray[Any]]

_AXES: Final = "xyzw"
_OF_COLUMNS: Final[Mapping[str, str]] = {PLANT: "plant", FRESH: "fresh", PROMPT: "prompt_estimates"}
_OF_GROUPS: Final[Mapping[str, str]] = {"estimates": ESTIMATES, "orientations": ORIENTATIONS}


class Table(Sequence[Columns]):
    """A table as a sequence of pieces with the same columns; each piece is built at access and not kept.

    Millions of rows with text would take GB of memory.
    """

    def __init__(self, makers: Sequence[Callable[[], Columns]]) -> None:
        self._makers = makers
        self._names: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the columns; builds a piece if none was built yet."""
        return self._names or tuple(self[0])

    @overload
    def __getitem__(self, i: int) -> Columns: ...
    @overload
    def __getitem__(self, i: slice) -> "Table": ...
    def __getitem__(self, i: int | slice) -> "Columns | Table":
        if isinstance(i, slice):
            return Table(self._makers[i])
        piece = self._makers[i]()
        self._names = tuple(piece)
        return piece

    def __len__(self) -> int:
        return len(self._makers)


def tables(run: Run) -> Iterator[tuple[str, Table]]:
    """Yield name and content of each table that has rows.

    Instants are run time in ns by netem's clock, positions in m. Oracle: the logs' own records
    (tests/deploy/export/test_export).
    """
    for name, make in _WHOLE.items():
        if len(next(iter(make(run).values()), ())):
            yield name, Table([partial(make, run)])
    for name, makers in _in_pieces(run):
        if makers:
            yield name, Table(makers)


def _tracks(run: Run) -> Columns:
    return _stacked([_track(run, hand) for hand in run.tracks])


def _truth(run: Run) -> Columns:
    return _stacked(
        [{**_constant("hand", hand, len(at.sample_ns)), **_flat(at._asdict())} for hand, at in run.truth.items()]
    )


def _ticks(run: Run) -> Columns:
    return _stacked([{**_constant("side", side, len(at.tick)), **at._asdict()} for side, at in run.ticks.items()])


def _ages(run: Run) -> Columns:
    return _stacked([{**_constant("hand", hand, len(at.t_ns)), **at._asdict()} for hand, at in run.ages.items()])


_WHOLE: Final = {"tracks": _tracks, "truth": _truth, "ticks": _ticks, "ages": _ages}


def _in_pieces(run: Run) -> Iterator[tuple[str, list[Callable[[], Columns]]]]:
    """Yield the large tables with the makers of their non-empty pieces."""
    messages = [(side, key, len(at)) for side, log in run.logs.sides.items() for key, at in log.messages.items()]
    yield "messages", [partial(_messages, run, side, key) for side, key, n in messages if n]
    for name, by_key, make in (("fates", fates_by_key, _fates), ("releases", releases_by_key, _releases)):
        packets = [(way, key, len(of.seq)) for way in run.fates for key, of in by_key(run.logs, way).items()]
        yield name, [partial(make, run.logs, way, key) for way, key, n in packets if n]
    shared = {name: list[Callable[[], Columns]]() for name in (*_OF_GROUPS, "set_points", "displays")}
    for side, log in run.logs.sides.items():
        for topic, rows in log.rows.items():
            if not rows:
                continue
            if not isinstance(rows, Rows):
                name = f"{side}_{topic.removeprefix('/tis/').replace('/', '_')}"
                yield name, [partial(_of_rows, rows)]
            elif topic in _OF_COLUMNS:
                yield _OF_COLUMNS[topic], [partial(_of_columns, rows)]
            elif (group := _shared_table(topic)) is not None:
                shared[group].append(partial(_of_columns, rows))
    yield from shared.items()


def _shared_table(topic: str) -> str | None:
    """Return the table that holds the records of several such topics; None for any other topic."""
    if is_set_point(topic):
        return "set_points"
    if is_predicted(topic):
        return "displays"
    return next((name for name, group in _OF_GROUPS.items() if topic.startswith(f"{group}/")), None)


def _messages(run: Run, side: Side, key: str) -> Columns:
    at = run.messages[side][key]
    return {**_constant("side", side, len(at.seq)), **_constant("key", key, len(at.seq)), **at._asdict()}


def _fates(logs: RunLogs, way: Direction, key: str) -> Columns:
    return _packets(way, key, fates_by_key(logs, way)[key], "outcome", OUTCOMES)


def _releases(logs: RunLogs, way: Direction, key: str) -> Columns:
    return _packets(way, key, releases_by_key(logs, way)[key], "departure", DEPARTURES)


def _track(run: Run, hand: Hand) -> Columns:
    track = run.tracks[hand]
    table = {**_constant("hand", hand, len(track.t_ns)), "t_ns": track.t_ns, "scored": track.scored}
    table |= _flat({"truth_m": track.truth_m})
    for name, position_m in track.estimates.items():
        column = plain_name(name)
        table |= _flat({f"{column}_m": position_m})
        table[f"{column}_error_mm"] = MM_PER_M * np.linalg.norm(position_m - track.truth_m, axis=1)
    for method in run.turns[hand].turn_rad:
        table[f"orientation_{method}_error_deg"] = run.error_deg(method, hand)
    return table


def _packets(way: Direction, key: str, books: Fates | Releases, coded: str, names: Sequence[str]) -> Columns:
    n = len(books.seq)
    table = {**_constant("direction", way, n), **books._asdict(), **_constant("key", key, n)}
    table[coded] = np.array(names, dtype=np.str_)[table[coded]]
    del table["keys"]
    return table


def _of_columns(rows: Rows) -> Columns:
    return _flat({name: rows.column(name) for name in rows.names})


def _of_rows(rows: Sequence[Row]) -> Columns:
    """Return the scalar fields of rows; missing values are empty text."""
    names = dict.fromkeys(name for row in rows for name, value in row.items() if not isinstance(value, list | dict))
    return {name: np.array(["" if row.get(name) is None else row[name] for row in rows]) for name in names}


def _flat(columns: Mapping[str, NDArray[Any]]) -> Columns:
    """Return the columns, (N, 3) and (N, 4) ones split: ``position_m`` becomes ``position_x_m`` and so on."""
    table: Columns = {}
    for name, values in columns.items():
        if values.ndim == 1:
            table[name] = values
            continue
        unit = next((unit for unit in ("_m", "_rad") if name.endswith(unit)), "")
        for i in range(values.shape[1]):
            table[f"{name.removesuffix(unit)}_{_AXES[i]}{unit}"] = values[:, i]
    return table


def _constant(name: str, value: str, n: int) -> Columns:
    return {name: np.broadcast_to(np.array(value), n)}


def _stacked(parts: Sequence[Columns]) -> Columns:
    """Return tables concatenated; a missing column is NaN."""
    names = dict.fromkeys(name for part in parts for name in part)
    return {name: np.concatenate([_or_nan(part, name) for part in parts]) for name in names}


def _or_nan(part: Columns, name: str) -> NDArray[Any]:
    return part[name] if name in part else np.full(len(next(iter(part.values()))), np.nan)
