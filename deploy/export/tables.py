"""Tables of a run's records: named columns of equal length, for any file format."""

import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, Final, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Direction, Hand, Side
from tis.common.messages import meanings
from tis.common.records import TICKS, TRUTH
from tis.common.scenario.estimator_names import plain_name
from tis.common.topic import Topic
from tis.common.topics import LOCAL, TOPICS, topic_of
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


# README.md of an export: meanings and units of the columns of each table, from the models of the records.

_DERIVED: Final[Mapping[str, tuple[str, Mapping[str, str]]]] = {
    "fates": ("A row for each message offered to netem: the decision of its models.", {}),
    "releases": ("A row for each message or copy that left netem's buffer: when and how.", {}),
    "tracks": (
        "A row for each tick of the patient: the true position of the arm, and every estimate.",
        {"t_ns": "instant of the tick", "scored": "1: the tick counts in the summary's accuracy"},
    ),
    "ages": (
        "A row for each tick of the patient with a sample: the age of the freshest one.",
        {"t_ns": "instant of the tick", "age_ns": "instant of the tick minus that of the freshest sample"},
    ),
    "messages": (
        "A row for each message that the surgeon or the patient sent or received.",
        {
            "key": "Zenoh key of the message",
            "seq": "sequence number of the message on its key",
            "sent_ns": "when it was sent",
            "log_ns": "when this side sent or received it",
            "sample_ns": "instant at which the sample was taken",
            "command_sample_ns": "sample instant of the command that the message answers; -1: none",
        },
    ),
}
"""Tables that are computed: what a row is, and what its columns are that are no fields of a record."""

_ADDED: Final[Mapping[str, str]] = {"hand": "left or right", "side": "side of the log: surgeon or patient"}
_OF_TABLE: Final = {topic.table: topic for topic in (*TOPICS.values(), *LOCAL.values())}
_UNITS: Final = {**{unit: unit for unit in ("ns", "us", "mm", "m", "rad", "deg", "ppm", "bytes")}, "n": "N"}
_AXIS: Final = re.compile(r"(.+)_([xyzw])(_m|_rad|_n)?")
_BY_NAME: Final = (
    (re.compile(r"truth_([xyz])_m"), "true position of the arm along {0}"),
    (re.compile(r"(.+)_error_deg"), "angle between {0}'s orientation and the true one; empty: none"),
    (re.compile(r"(.+)_error_mm"), "distance of {0}'s estimate from the truth; empty: no estimate"),
    (re.compile(r"(.+)_([xyz])_m"), "estimate of {0} along {1}; empty: none"),
)
_JIGSAWS: Final = """\
## Trials in the format of JIGSAWS

Text files as those of the data set (`Task/kinematics/AllGestures/Task_TRIAL.txt`): no header, 76 columns, 30 rows a
second. Columns 1-19 are the left master, 20-38 the right one, 39-57 the first patient-side arm (PSM1), 58-76 the
second (PSM2). Of each 19: position x, y, z (m), rotation matrix (9, row by row), velocity x, y, z (m/s), rotational
velocity x, y, z (rad/s), gripper angle (rad).

- `R001` has the surgeon's messages: the masters, and each arm as recorded.
- `R002` has the same masters, and each arm as the patient estimated it at the tick of that sample. The difference to
  `R001`, row by row, is the estimation error.

Velocities are differences of neighbouring rows, an absent hand rests at the origin, and a row without a sample or
estimate repeats the previous one. `tis` plays both:
`source: {kind: jigsaws, path: THIS_FOLDER, task: TASK, trial: R001}`.
"""


class Column(NamedTuple):
    """A column's name, unit and meaning; "" for none."""

    name: str
    unit: str
    meaning: str


def columns_of(table: str, names: Sequence[str]) -> list[Column]:
    """Return the columns of a table with their meanings (completeness: tests/deploy/export/test_columns)."""
    return [Column(name, unit_of(name), _meaning(table, name)) for name in names]


def table_meaning(table: str) -> str:
    """Return the meaning of a table's rows; "" for an unknown table."""
    if table in _DERIVED:
        return _DERIVED[table][0]
    topic = _topic(table)
    return "" if topic is None else topic.about


def readme(
    title: str, lacking: Sequence[str], columns: Mapping[str, Sequence[str]], suffixes: Sequence[str], jigsaws: bool
) -> str:
    """Return the README.md of an export: the columns of each table, and the JIGSAWS trials."""
    return "\n".join(_lines(title, lacking, columns, suffixes, jigsaws))


def _lines(
    title: str, lacking: Sequence[str], columns: Mapping[str, Sequence[str]], suffixes: Sequence[str], jigsaws: bool
) -> Iterator[str]:
    yield f"# {title}\n"
    for text in lacking:
        yield f"- incomplete: {text}"
    if lacking:
        yield ""
    if columns:
        yield "Times are run time: ns since the run's epoch, by netem's clock. Positions are in m.\n"
        yield "Booleans (true, false) are 1 and 0 in CSV; null is an empty field, or NaN.\n"
    for table, names in columns.items():
        yield f"## {' and '.join(f'{table}{suffix}' for suffix in suffixes)}\n"
        yield f"{table_meaning(table)}\n"
        yield "| column | unit | meaning |\n|---|---|---|"
        for column in columns_of(table, names):
            yield f"| `{column.name}` | {column.unit} | {column.meaning} |"
        yield ""
    if jigsaws:
        yield _JIGSAWS


def _topic(table: str) -> Topic | None:
    """Return the topic of a table's records; the name of rare ones begins with a side."""
    side, _, rest = table.partition("_")
    return _OF_TABLE.get(rest) if side in get_args(Side) else _OF_TABLE.get(table)


def _meaning(table: str, name: str) -> str:
    topic = _topic(table)
    told = {} if topic is None else meanings(topic.model)
    texts = _DERIVED[table][1] if table in _DERIVED else {}
    of_axis = _AXIS.fullmatch(name)
    if told.get(name):
        return told[name]
    vector = told.get(f"{of_axis[1]}{of_axis[3] or ''}") if of_axis else None
    if vector and of_axis:
        return f"{vector} Component {of_axis[2]}."
    by_name = (text.format(*match.groups()) for pattern, text in _BY_NAME if (match := pattern.fullmatch(name)))
    return texts.get(name) or _ADDED.get(name) or next(by_name, "")


def unit_of(name: str) -> str:
    """Return the unit that a name of a column or a field states; "" for none."""
    if name.startswith("n_bytes"):
        return "bytes"
    last = name.rpartition("_")[2]
    return _UNITS.get(last, "") if last != name else ""
