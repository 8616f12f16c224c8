"""Tables of a run's records: named columns of equal length, for any file format."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, Final, get_args

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Direction, Hand, Side
from tis.common.records import TICKS, TRUTH
from tis.common.scenario.estimator_names import plain_name
from tis.common.topics import topic_of
from tis.common.units import MM_PER_M
from tis.deploy.logs.payloads import Row
from tis.deploy.logs.read.frame import Frame
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.packets import fates_by_key, releases_by_key
from tis.deploy.logs.read.side_log import DEPARTURES, MESSAGES, OUTCOMES
from tis.deploy.report.run_data import Run

Columns = Mapping[str, NDArray[Any]]
Pieces = Sequence[Callable[[], Columns]]
"""A table in pieces with the same columns; each is built when it is called: millions of rows with text take GB."""

_AXES: Final = "xyzw"


def tables(run: Run) -> Iterator[tuple[str, Pieces]]:
    """Yield name and content of each table that has rows.

    Instants are run time in ns by netem's clock, positions in m. Oracle: the logs' own records
    (tests/deploy/export/test_export).
    """
    for name, make in _WHOLE.items():
        if len(next(iter(make(run).values()), ())):
            yield name, [partial(make, run)]
    yield from tables_of_logs(run.logs)


def tables_of_logs(logs: RunLogs) -> Iterator[tuple[str, Pieces]]:
    """Yield name and content of each table of records as they are logged."""
    for name, pieces in _in_pieces(logs):
        if pieces:
            yield name, pieces


def _tracks(run: Run) -> Columns:
    return _stacked([_track(run, hand) for hand in run.tracks])


def _truth(run: Run) -> Columns:
    return _stacked([{**_constant("hand", hand, len(at)), **_of_frame(at)} for hand, at in run.truth.items()])


def _ticks(run: Run) -> Columns:
    return _stacked([{**_constant("side", side, len(at)), **_of_frame(at)} for side, at in run.ticks.items()])


def _ages(run: Run) -> Columns:
    return _stacked([{**_constant("hand", hand, len(at)), **_of_frame(at)} for hand, at in run.ages.items()])


_WHOLE: Final = {"tracks": _tracks, "truth": _truth, "ticks": _ticks, "ages": _ages}


def _in_pieces(logs: RunLogs) -> Iterator[tuple[str, Pieces]]:
    """Yield the large tables with their non-empty pieces."""
    messages = [(side, key, frame) for side, log in logs.sides.items() for key, frame in log.messages.items()]
    yield "messages", [partial(_messages, *each) for each in messages if len(each[2])]
    for name, of, coded, texts in (
        ("fates", fates_by_key, "outcome", OUTCOMES),
        ("releases", releases_by_key, "departure", DEPARTURES),
    ):
        packets = [(way, key) for way in get_args(Direction) for key, frame in of(logs, way).items() if len(frame)]
        yield name, [partial(_packets, logs, of, way, key, coded, texts) for way, key in packets]
    frequent: defaultdict[str, list[Callable[[], Columns]]] = defaultdict(list)
    for side, log in logs.sides.items():
        for key, frame in log.rows.items():
            topic = topic_of(key)
            if topic is None or not topic.is_frequent:
                if len(frame):
                    yield f"{side}_{key.removeprefix('/tis/').replace('/', '_')}", [partial(_of_rows, frame)]
            elif len(frame) and topic not in (TICKS, TRUTH):
                frequent[topic.table].append(partial(_of_frame, frame))
    yield from frequent.items()


def _messages(side: Side, key: str, frame: Frame) -> Columns:
    columns = {name: frame.column(name) for name in MESSAGES if name != "fingerprint"}
    return {**_constant("side", side, len(frame)), **_constant("key", key, len(frame)), **columns}


def _packets(
    logs: RunLogs,
    of: Callable[[RunLogs, Direction], dict[str, Frame]],
    way: Direction,
    key: str,
    coded: str,
    texts: Sequence[str],
) -> Columns:
    frame = of(logs, way)[key]
    n = len(frame)
    columns = {name: frame.column(name) for name in frame.names}
    columns[coded] = np.array(texts, dtype=np.str_)[columns[coded]]
    return {**_constant("direction", way, n), **_constant("key", key, n), **columns}


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


def _of_frame(frame: Frame) -> Columns:
    return _flat({name: frame.column(name) for name in frame.names})


def _of_rows(rows: Sequence[Row]) -> Columns:
    """Return the scalar fields of rows; missing values are empty text."""
    names = dict.fromkeys(name for row in rows for name, value in row.items() if not isinstance(value, list | dict))
    return {name: np.array(["" if row.get(name) is None else row[name] for row in rows]) for name in names}


def _flat(columns: Mapping[str, NDArray[Any]]) -> Columns:
    """Return the columns, (N, 3) and (N, 4) ones split: ``force_n`` becomes ``force_x_n`` and so on."""
    table: dict[str, NDArray[Any]] = {}
    for name, values in columns.items():
        if values.ndim == 1:
            table[name] = values
            continue
        unit = next((unit for unit in ("_m", "_rad", "_n") if name.endswith(unit)), "")
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
