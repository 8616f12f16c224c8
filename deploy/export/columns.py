"""README.md of an export: meanings and units of the columns of each table, from the models of the records."""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Final, NamedTuple, get_args

from tis.common.channels import Side
from tis.common.messages import meanings
from tis.common.topic import Topic
from tis.common.topics import LOCAL, TOPICS

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
