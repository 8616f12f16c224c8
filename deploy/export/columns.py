"""What the columns of exported tables mean, with their units: the README.md of an export."""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Final, NamedTuple

from deploy.logs.read.batches import DEPARTURES, OUTCOMES

_TABLES: Final[Mapping[str, str]] = {
    "tracks": "A row for each tick of the patient: where the arm really was, and where each estimator put it.",
    "truth": "A row for each sample: where the recorded arm was, which no estimator gets to see.",
    "ticks": "A row for each tick of the surgeon and of the patient.",
    "ages": "A row for each tick of the patient at which it had a sample: how old the freshest one was.",
    "messages": "A row for each message that the surgeon or the patient sent or received.",
    "fates": "A row for each message that was offered to netem: what its models decided.",
    "releases": "A row for each message or copy that left netem's hold: when, and how.",
    "estimates": "A row for each tick and estimator: its answer and the deviation that it states.",
    "prompt_estimates": "A row for each estimate made on arrival, between ticks (patient.tick: on_arrival).",
    "fresh": "A row for each tick that used a new freshest sample: which one.",
    "plant": "A row for each tick: where the arm of the patient's plant was.",
}
_RECORDS: Final[Mapping[str, str]] = {
    "estimator_faults": "The first time that an estimator of your own failed, and why; for each hand.",
    "counters": "A row for each counter of this side at the end of the run.",
    "rejected": "A row for each message that this side could not use: damaged, or not ours.",
    "queues": "The depth of a rate's queue, at most every 10 ms.",
    "control": "A row for each change of the network that was asked for while the run lasted.",
    "tick_phases": "A row for each time that the patient moved its ticks (patient.tick: phase_locked).",
    "clock": "How this side's clock stood to netem's at the beginning.",
    "clock_exchanges": "A row for each exchange of four time stamps with netem.",
    "clock_discipline": "What this host's kernel said of its clock (adjtimex).",
    "processors": "Who had the processors that this side may use, during the run. Empty: not known.",
}
_COLUMNS: Final[Mapping[str, str]] = {
    "hand": "left or right",
    "side": "whose log it is from: surgeon or patient",
    "key": "Zenoh key of the message",
    "direction": "forward: surgeon to patient; feedback: back",
    "estimator": "name of the estimator",
    "tick": "number of the tick, from 0",
    "t_ns": "instant of the tick",
    "due_ns": "instant at which the tick was due",
    "begin_ns": "instant at which it was begun",
    "missed": "1: it was not begun before the next one was due",
    "scored": "1: the tick counts in the summary's accuracy",
    "sample_ns": "instant at which the sample was taken",
    "command_sample_ns": "instant of the command that the message answers; -1: it answers none",
    "age_ns": "instant of the tick minus that of the freshest sample",
    "seq": "sequence number of the message on its key",
    "sent_ns": "when it was sent",
    "foreign": "1: not a message of the testbed",
    "offered_ns": "when it reached netem",
    "outcome": f"what was decided: {', '.join(OUTCOMES)}",
    "delay_ns": "delay that the models drew, without queue and ordering",
    "release_ns": "instant at which it was to leave, after ordering; 0: not delivered, or for a queue to say",
    "released_ns": "instant at which it left; 0: it was dropped after all",
    "departure": f"how it left: {', '.join(DEPARTURES)}",
    "queued_ns": "time in the queue of a rate, transmission included",
    "n_bytes": "size of its payload",
    "copies": "copies that netem made of it",
    "copy_index": "0: the original, else the number of the copy",
    "flipped": "bits of its payload that netem flipped",
    "step_ns": "time that one step of the estimator took; 0 in virtual time",
    "answer": "sequence number of the answer that carried it; empty: that of the tick, or none",
    "name": "name of the counter",
    "value": "its value",
    "recv_ns": "when it was received",
    "reason": "why it was refused",
    "head_hex": "its first bytes, hexadecimal",
    "at_ns": "when it was noted",
    "applied_ns": "from when on it held; 0: it was refused",
    "operation": "set, outage, reset or profile",
    "request": "what was asked for, as JSON",
    "added": "what it became in the network's timeline, as JSON",
    "accepted": "1: it was done",
    "n_packets": "packets in the queue",
    "phase_ns": "how far the ticks lie behind the sample instants from then on",
    "age_before_ns": "mean age before the move",
    "boot_id": "which start of which host this side's clock belongs to",
    "reference_boot_id": "the same of netem's",
    "shared": "1: both are one clock",
    "epoch_ns": "what this side's clock showed at run time 0",
    "reference_epoch_ns": "what netem's clock showed then",
    "asked_ns": "by this side's clock: asked",
    "received_ns": "by netem's clock: the question came",
    "replied_ns": "by netem's clock: the answer went",
    "answered_ns": "by this side's clock: the answer came",
    "synchronised": "1: a time service keeps this clock",
    "estimated_error_us": "the kernel's estimate of its error",
    "maximum_error_us": "the kernel's bound of it",
    "frequency_ppm": "correction of the rate that the kernel applies",
    "from_ns": "from when on it was counted",
    "to_ns": "until when",
    "processors": "numbers of those that it may use; all of them are added up",
    "own_ns": "their time that this side's process used",
    "busy_ns": "their time that all programs used, this one too",
    "idle_ns": "their time in which there was nothing to do",
    "iowait_ns": "the same while a disk was waited for",
    "steal_ns": "their time that the host of this virtual machine took",
    "quota_processors": "processors' time that the side's control group may use in each period",
    "n_periods": "periods of that quota",
    "n_throttled": "periods in which the group was held back",
    "throttled_ns": "time that it was held back, added up over processors",
}
_IN_TABLE: Final[Mapping[tuple[str, str], str]] = {
    ("estimator_faults", "t_ns"): "instant that the estimate was to be for",
    ("estimator_faults", "reason"): "what went wrong",
    ("messages", "log_ns"): "when this side sent or received it",
    ("queues", "n_bytes"): "bytes in the queue",
    ("tick_phases", "age_ns"): "mean age of the samples that is expected from then on",
    ("tick_phases", "tick"): "the last tick before the move",
    ("clock_exchanges", "received_ns"): "by netem's clock: when the question came",
    ("prompt_estimates", "t_ns"): "instant that the estimate is for: the arrival",
}
_UNITS: Final = ("ns", "us", "mm", "m", "rad", "ppm", "bytes")
_BY_NAME: Final = (
    (re.compile(r"truth_([xyz])_m"), "true place of the arm along {0}"),
    (re.compile(r"position_([xyz])_m"), "place along {0}"),
    (re.compile(r"std_([xyz])_m"), "standard deviation that the estimator states along {0}; empty: none"),
    (re.compile(r"(.+)_error_mm"), "distance of {0}'s estimate from the truth; empty: no estimate"),
    (re.compile(r"(.+)_([xyz])_m"), "estimate of {0} along {1}; empty: none"),
)
_JIGSAWS: Final = """\
## Trials in the format of JIGSAWS

Text files as those of the data set (`Task/kinematics/AllGestures/Task_TRIAL.txt`): no header, 76 columns, 30 rows a
second. Columns 1-19 are the left master, 20-38 the right one, 39-57 the first patient-side arm (PSM1), 58-76 the
second (PSM2). Of each 19: position x, y, z (m), rotation matrix (9, row by row), velocity x, y, z (m/s), rotational
velocity x, y, z (rad/s), gripper angle (rad).

- `R001` is what the surgeon sent: the masters, and each arm as it was recorded.
- `R002` has the same masters, and each arm as the patient estimated it at the tick of that sample: what the network
  and the estimator made of `R001`. Their difference, row by row, is the estimation error.

Velocities are differences of neighbouring rows, a hand that took no part rests at the origin, and a row without a
sample or estimate repeats the one before. `tis` plays both again:
`source: {kind: jigsaws, path: THIS_FOLDER, task: TASK, trial: R001}`.
"""


class Column(NamedTuple):
    """A column's name, unit ("" where it has none) and meaning ("" where nobody wrote one)."""

    name: str
    unit: str
    meaning: str


def columns_of(table: str, names: Sequence[str]) -> list[Column]:
    """Return what the columns of a table mean (that none is without: tests/deploy/export/test_columns)."""
    return [Column(name, _unit(name), _meaning(_kind(table), name)) for name in names]


def table_meaning(table: str) -> str:
    """Return what a row of a table is; "" where nobody wrote it."""
    return _TABLES.get(table, _RECORDS.get(_kind(table), ""))


def readme(
    title: str, lacking: Sequence[str], columns: Mapping[str, Sequence[str]], suffixes: Sequence[str], jigsaws: bool
) -> str:
    """Return the README.md of an export: each table's columns by name, and what the JIGSAWS trials hold."""
    return "\n".join(_lines(title, lacking, columns, suffixes, jigsaws))


def _lines(
    title: str, lacking: Sequence[str], columns: Mapping[str, Sequence[str]], suffixes: Sequence[str], jigsaws: bool
) -> Iterator[str]:
    yield f"# {title}\n"
    for text in lacking:
        yield f"- not all of the run is here: {text}"
    if lacking:
        yield ""
    if columns:
        yield "Times are run time: ns since the run's epoch, by netem's clock. Positions are in m.\n"
        yield "Booleans are 0 and 1 in CSV; an empty field, or NaN, is a value that does not exist.\n"
    for table, names in columns.items():
        yield f"## {' and '.join(f'{table}{suffix}' for suffix in suffixes)}\n"
        yield f"{table_meaning(table)}\n"
        yield "| column | unit | meaning |\n|---|---|---|"
        for column in columns_of(table, names):
            yield f"| `{column.name}` | {column.unit} | {column.meaning} |"
        yield ""
    if jigsaws:
        yield _JIGSAWS


def _kind(table: str) -> str:
    """Return what kind of records a table has: those of one side are named after it."""
    for side in ("surgeon_", "netem_", "patient_"):
        if table.startswith(side):
            return table.removeprefix(side)
    return table


def _meaning(kind: str, name: str) -> str:
    found = _IN_TABLE.get((kind, name)) or _COLUMNS.get(name)
    if found is not None:
        return found
    for pattern, text in _BY_NAME:
        if match := pattern.fullmatch(name):
            return text.format(*match.groups())
    return ""


def _unit(name: str) -> str:
    if name.startswith("n_bytes"):
        return "bytes"
    last = name.rpartition("_")[2]
    return last if last in _UNITS and last != name else ""
