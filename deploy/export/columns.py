"""Meanings and units of the columns of exported tables, for the README.md of an export."""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Final, NamedTuple

from tis.deploy.logs.read.batches import DEPARTURES, OUTCOMES

_TABLES: Final[Mapping[str, str]] = {
    "tracks": "A row for each tick of the patient: the true position of the arm, and every estimate.",
    "truth": "A row for each sample: the position of the recorded arm, which no estimator sees.",
    "ticks": "A row for each tick of the surgeon and of the patient.",
    "ages": "A row for each tick of the patient with a sample: the age of the freshest one.",
    "messages": "A row for each message that the surgeon or the patient sent or received.",
    "fates": "A row for each message offered to netem: the decision of its models.",
    "releases": "A row for each message or copy that left netem's buffer: when and how.",
    "orientations": "A row for each tick and orientation method: the arm's orientation and gripper, and their "
    "stated standard deviations.",
    "estimates": "A row for each tick and estimator: the estimate and its stated standard deviation.",
    "prompt_estimates": "A row for each estimate made on arrival, between ticks (patient.tick: on_arrival).",
    "fresh": "A row for each tick with a new freshest sample: that sample.",
    "set_points": "A row for each tick and arm: what drives it, the estimate within its limits.",
    "displays": "A row for each tick of the surgeon from the first feedback on: what the display shows of the arm.",
    "plant": "A row for each tick: the position of the plant's arm.",
}
_RECORDS: Final[Mapping[str, str]] = {
    "estimator_faults": "The first failure of each user-defined estimator and its cause, by hand.",
    "counters": "A row for each counter of this side at the end of the run.",
    "rejected": "A row for each message that this side rejected: damaged, or not of the testbed.",
    "quarantine": "A row for each message that the patient received and did not use, and why.",
    "safety": "A row for each change of an arm's safety state.",
    "emergency_stops": "A row for each request to stop or to release that was carried out, or refused.",
    "stops_in_force": "A row for each change of the emergency stops in force.",
    "queues": "The depth of a rate's queue, at most every 10 ms.",
    "control": "A row for each control request during the run.",
    "tick_phases": "A row for each phase change of the patient's ticks (patient.tick: phase_locked).",
    "clock": "This side's clock against netem's at the begin of the run.",
    "clock_exchanges": "A row for each exchange of four time stamps with netem.",
    "peers": "A row for each change in the life of a side, as this side noticed it.",
    "clock_discipline": "The kernel's report on the clock of this host (adjtimex).",
    "processors": "Use of the processors available to this side, over the run. Empty: unknown.",
}
_COLUMNS: Final[Mapping[str, str]] = {
    "hand": "left or right",
    "side": "side of the log: surgeon or patient",
    "key": "Zenoh key of the message",
    "direction": "forward: surgeon to patient; feedback: back",
    "estimator": "name of the estimator",
    "method": "name of the orientation method",
    "gripper_rad": "opening angle of the gripper; empty: none",
    "gripper_std_rad": "stated standard deviation of the gripper's angle; empty: none",
    "tick": "number of the tick, from 0",
    "t_ns": "instant of the tick",
    "due_ns": "instant at which the tick was due",
    "begin_ns": "instant at which it began",
    "missed": "1: it had not begun when the next one was due",
    "scored": "1: the tick counts in the summary's accuracy",
    "sample_ns": "instant at which the sample was taken",
    "command_sample_ns": "sample instant of the command that the message answers; -1: none",
    "age_ns": "instant of the tick minus that of the freshest sample",
    "seq": "sequence number of the message on its key",
    "sent_ns": "when it was sent",
    "foreign": "1: not a message of the testbed",
    "offered_ns": "when it reached netem",
    "outcome": f"decision: {', '.join(OUTCOMES)}",
    "delay_ns": "delay that the models drew, without queue and ordering",
    "release_ns": "decided instant of leaving, after ordering; 0: not delivered, or left to a queue",
    "released_ns": "instant at which it left; 0: it was dropped later",
    "departure": f"how it left: {', '.join(DEPARTURES)}",
    "queued_ns": "time in the queue of a rate, transmission included",
    "shown_tick": "tick of the patient whose feedback is shown",
    "command_ns": "sample instant of the newest command behind that feedback",
    "round_trip_ns": "from that command to the arrival of the feedback",
    "n_bytes": "size of its payload",
    "copies": "copies that netem made of it",
    "copy_index": "0: the original, else the number of the copy",
    "flipped": "bits of its payload that netem flipped",
    "step_ns": "time that one step of the estimator took; 0 in virtual time",
    "answer": "sequence number of the message that carried it; empty: that of the tick, or none",
    "name": "name of the counter",
    "value": "its value",
    "recv_ns": "when it was received",
    "reason": "reason of the rejection",
    "head_hex": "its first bytes, hexadecimal",
    "at_ns": "when it was recorded",
    "clamped": "1: the set point in force lay outside what the joints of the arm reach",
    "before": "safety state until then",
    "mode": "safety state: tracking, resuming, hold, slow_stop or safe",
    "cause": "reason of the change",
    "peer": "side concerned",
    "event": "left, frozen, link_down, silent, back, stalled, resumed, clock_step or suspended",
    "for_ns": "how long it has been so, or how far the clock stepped",
    "doing": "step in which a loop stays",
    "stop": "1: stop; 0: release",
    "number": "number of the request; of a stop that under which it is in force",
    "ends": "number of the stop that a release ends",
    "by_stopper": "1: the release had the stop's secret; 0: it had not; empty: the stop has none",
    "stopped": "1: the arms are stopped after it",
    "changed": "1: it changed whether they are stopped",
    "refused": "why it was not carried out; empty: it was",
    "stops": "NUMBER:LOCK of the newest stops in force",
    "others": "number of older stops in force",
    "applied_ns": "instant from which it applied; 0: it was refused",
    "operation": "set, outage, reset or profile",
    "request": "the request, as JSON",
    "added": "the resulting timeline entry, as JSON",
    "accepted": "1: it was accepted",
    "n_packets": "packets in the queue",
    "phase_ns": "new phase of the ticks after the sample instants",
    "age_before_ns": "mean age before the change",
    "boot_id": "boot id of the host of this side's clock",
    "reference_boot_id": "the same of netem's",
    "shared": "1: both sides use one clock",
    "epoch_ns": "this side's clock at run time 0",
    "reference_epoch_ns": "netem's clock at run time 0",
    "asked_ns": "by this side's clock: request sent",
    "received_ns": "by netem's clock: request received",
    "replied_ns": "by netem's clock: reply sent",
    "answered_ns": "by this side's clock: reply received",
    "synchronised": "1: a time service disciplines this clock",
    "estimated_error_us": "the kernel's estimate of its error",
    "maximum_error_us": "the kernel's bound of it",
    "frequency_ppm": "correction of the rate that the kernel applies",
    "from_ns": "begin of the measurement",
    "to_ns": "end of the measurement",
    "processors": "numbers of the processors that the side may use; times are sums over them",
    "own_ns": "processor time used by this side's process",
    "busy_ns": "processor time used by all programs, this one too",
    "idle_ns": "idle processor time",
    "iowait_ns": "idle processor time while waiting for a disk",
    "steal_ns": "processor time taken by the host of this virtual machine (steal)",
    "quota_processors": "processor time that the side's control group may use, in processors",
    "n_periods": "periods of that quota",
    "n_throttled": "periods in which the group was throttled",
    "throttled_ns": "throttled time, summed over processors",
}
_IN_TABLE: Final[Mapping[tuple[str, str], str]] = {
    ("estimator_faults", "t_ns"): "instant of the estimate that failed",
    ("estimator_faults", "reason"): "cause of the failure",
    ("emergency_stops", "reason"): "reason that was given",
    ("messages", "log_ns"): "when this side sent or received it",
    ("queues", "n_bytes"): "bytes in the queue",
    ("tick_phases", "age_ns"): "expected mean age of samples after the change",
    ("tick_phases", "tick"): "the last tick before the change",
    ("clock_exchanges", "received_ns"): "by netem's clock: request received",
    ("displays", "tick"): "number of the surgeon's tick, from 0",
    ("displays", "sample_ns"): "instant of that tick, at which the newest command was taken",
    ("prompt_estimates", "t_ns"): "instant of the estimate: the arrival",
}
_UNITS: Final = ("ns", "us", "mm", "m", "rad", "deg", "ppm", "bytes")
_BY_NAME: Final = (
    (re.compile(r"truth_([xyz])_m"), "true position of the arm along {0}"),
    (re.compile(r"position_([xyz])_m"), "position along {0}"),
    (re.compile(r"std_([xyz])_m"), "stated standard deviation along {0}; empty: none"),
    (re.compile(r"shown_([xyz])_m"), "position of the arm in the feedback that is shown, along {0}"),
    (re.compile(r"orientation_([xyzw])"), "orientation, component {0} of the quaternion; empty: none"),
    (re.compile(r"rotation_([xyz])_rad"), "true orientation as a rotation vector, along {0}"),
    (re.compile(r"(?:turn_)?std_([xyz])_rad"), "stated standard deviation about the estimate's {0}; empty: none"),
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
    return [Column(name, _unit(name), _meaning(_kind(table), name)) for name in names]


def table_meaning(table: str) -> str:
    """Return the meaning of a table's rows; "" for an unknown table."""
    return _TABLES.get(table, _RECORDS.get(_kind(table), ""))


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
    """Return the kind of a table's records: its name without the side."""
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
