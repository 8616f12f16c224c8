"""Choice of topics, and their messages as streams. Pure.

Topics are those that the user names, else those with CRTK's names of the da Vinci's devices. Streams are in order of
time, each instant once; what was left out is said in words.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from tis.common.errors import DataError, Fault, InputError
from tis.common.scenario.table_source import PoseColumns, PoseUnits
from tis.common.sources.table_columns import MIN_ROWS, DeviceLayout, in_few
from tis.common.sources.table_poses import finite_faults, pose_track
from tis.deploy.recordings_import.element_names import column_of
from tis.deploy.recordings_import.found import DEVICES, MASTERS, Array, Extra, Ints, Jaw, Rows, Stream, Topic, Wanted
from tis.deploy.recordings_import.messages import Kind

_POSES: Final = ("measured_cp", "setpoint_cp", "servo_cp", "local/measured_cp")
_ARM_POSES: Final = ("setpoint_cp", "servo_cp", "measured_cp", "local/measured_cp")
_JAWS: Final = ("gripper/measured_js", "jaw/measured_js", "jaw/setpoint_js")
_ARM_JAWS: Final = ("jaw/setpoint_js", "jaw/measured_js", "gripper/measured_js")
_MAX_LISTED: Final = 40


def chosen(topics: Sequence[Topic], wanted: Wanted, where: str) -> tuple[dict[str, str], dict[str, str]]:
    """Return the topic of poses, and of gripper angles, of each device.

    Of an arm the commanded pose counts, as truth is the commanded pose; of a master the measured one. A single topic
    of poses, of any name, is the left master's. Raises `InputError` for topics that are not there or of another kind,
    `DataError` when no topic is found. Oracle: lists of topics in the tests.
    """
    by_name = {topic.name: topic for topic in topics}
    faults = [*_faults(wanted.topics, by_name, "pose", "--topic"), *_faults(wanted.jaws, by_name, "joints", "--jaw")]
    if faults:
        raise InputError(faults)
    poses, jaws = dict(wanted.topics), dict(wanted.jaws)
    for device in DEVICES:
        is_master = device in MASTERS
        if not wanted.topics:
            found = _first(topics, device, _POSES if is_master else _ARM_POSES, "pose")
            poses |= {} if found is None else {device: found}
        if device not in jaws and device in poses:
            found = _first(topics, device, _JAWS if is_master else _ARM_JAWS, "joints")
            jaws |= {} if found is None else {device: found}
    movements = [topic.name for topic in topics if topic.kind == "pose" and topic.n_messages >= MIN_ROWS]
    if not poses and len(movements) == 1:
        poses = {DEVICES[0]: movements[0]}  # nothing else can be meant
    if not poses:
        rule = "has no topic of poses like /MTML/measured_cp or /PSM2/setpoint_cp; --topic DEVICE=TOPIC names one"
        of_poses_first = sorted(topics, key=lambda topic: topic.kind != "pose")
        listed = ", ".join(f"{topic.name} ({topic.type})" for topic in of_poses_first[:_MAX_LISTED]) or "none"
        raise DataError(Fault(where, "", f"{rule}; its topics: {listed}"))
    return poses, jaws


def listing(topics: Sequence[Topic], poses: Mapping[str, str], jaws: Mapping[str, str]) -> list[str]:
    """Return a line for each topic: its type, its messages, and what it is imported as."""
    used = {name: f"poses of {device}" for device, name in poses.items()}
    used |= {name: f"gripper of {device}" for device, name in jaws.items()}
    lines = [
        f"{topic.name}: {topic.n_messages} of {topic.type or 'unknown type'}"
        + (f" -> {used[topic.name]}" if topic.name in used else "")
        for topic in sorted(topics, key=lambda topic: (topic.name not in used, topic.name))
    ]
    rest = len(lines) - _MAX_LISTED
    return lines if rest <= 0 else [*lines[:_MAX_LISTED], f"and {rest} more topics"]


def _faults(named: Mapping[str, str], topics: Mapping[str, Topic], kind: Kind, option: str) -> list[Fault]:
    words = {"pose": "poses", "joints": "joint states"}
    found = []
    for device, name in named.items():
        if device not in DEVICES:
            found.append(Fault("tis import", option, f"must begin with one of {', '.join(DEVICES)}", device))
        near = in_few([topic for topic, of in topics.items() if of.kind == kind], _MAX_LISTED) or "none"
        if name not in topics:
            found.append(Fault("tis import", option, f"must be a topic of the file; of {words[kind]}: {near}", name))
        elif topics[name].kind != kind:
            rule = f"must be a topic of {words[kind]}: {near}"
            found.append(Fault("tis import", option, rule, f"{topics[name].type}"))
    return found


def _first(topics: Sequence[Topic], device: str, endings: Sequence[str], kind: Kind) -> str | None:
    for ending in endings:
        pattern = re.compile(rf"(.*/)?{device}/{ending}", re.IGNORECASE)
        there = [t.name for t in topics if t.kind == kind and t.n_messages and pattern.fullmatch(t.name)]
        if there:
            return min(there, key=len)
    return None


_NAMES: Final = ("x", "y", "z", "qx", "qy", "qz", "qw")
_PLACE: Final = DeviceLayout("", PoseColumns(position=("x", "y", "z")), PoseUnits())
_WHOLE: Final = DeviceLayout(
    "", PoseColumns(position=("x", "y", "z"), quaternion=("qx", "qy", "qz", "qw")), PoseUnits()
)


def streams_of(
    poses: Mapping[str, str], jaws: Mapping[str, str], rows: Mapping[str, Rows], where: str, skips_unreadable: bool
) -> tuple[tuple[Stream, ...], tuple[Jaw, ...], list[str]]:
    """Return the streams and grippers of the chosen topics, and notes.

    Raises `DataError` for messages that cannot be read, unless they are skipped, for fewer than two poses, numbers
    that are not finite and quaternions whose norm is not 1. Messages are sorted by instant; of those with one instant
    the first counts. Oracle: shuffled and repeated messages, test_mcap_file.
    """
    faults = (
        []
        if skips_unreadable
        else [
            Fault(
                where,
                topic,
                "holds messages that cannot be read; --skip-unreadable leaves them out",
                of.n_undecodable,
            )
            for topic, of in rows.items()
            if of.n_undecodable and not of.width  # a wrench is no part of a pose
        ]
    )
    notes, streams, angles = list[str](), [], []
    for device, topic in poses.items():
        t_ns, values, found = _in_order(rows[topic], topic)
        notes += found
        if len(t_ns) < 2:
            faults.append(Fault(where, topic, "must have at least 2 poses that can be read", len(t_ns)))
            continue
        turned = ~np.isnan(values[:, 3:7]).any(axis=1)
        if turned.any() and not turned.all():
            notes.append(f"{topic}: {int((~turned).sum())} messages lack an orientation, so it is left out")
        columns = {name: values[:, k] for k, name in enumerate(_NAMES)}
        layout = _WHOLE if turned.all() else _PLACE
        bad = finite_faults({name: columns[name] for name in layout.names}, f"{where}: {topic}")
        if not bad:
            track, bad = pose_track(columns, layout, f"{where}: {topic}")
        if bad:
            faults += bad
            continue
        gripped = bool(np.isfinite(values[:, 7]).all())
        turns = track.orientation if turned.all() else None
        streams.append(Stream(device, topic, t_ns, track.position_m, turns, values[:, 7] if gripped else None))
    for device, topic in jaws.items():
        t_ns, values, found = _in_order(rows[topic], topic)
        notes += found
        if len(t_ns) < 2:
            notes.append(f"{topic}: fewer than 2 angles that can be read, so {device} gets none from it")
        else:
            bad = finite_faults({"position[0]": values[:, 0]}, f"{where}: {topic}")
            faults += bad
            angles += [] if bad else [Jaw(device, topic, t_ns, values[:, 0])]
    if faults:
        raise DataError(faults)
    return tuple(streams), tuple(angles), notes


_WRENCH: Final = tuple(
    (f"{kind}_{axis}", unit) for kind, unit in (("force", "N"), ("torque", "N m")) for axis in "xyz"
)


def wrenches_of(rows: Mapping[str, Rows]) -> tuple[tuple[Extra, ...], list[str]]:
    """Return forces and torques of all topics of wrenches as columns, and notes. Oracle: bags of the tests."""
    found, notes = list[Extra](), list[str]()
    for topic, of in rows.items():
        if of.width != len(_WRENCH):
            continue
        t_ns, values, said = _in_order(of, topic)
        notes += said
        if len(t_ns) < 2 or not np.isfinite(values).all():
            notes.append(f"{topic}: left out, as it has fewer than 2 messages, or numbers that are not finite")
            continue
        name = topic.strip("/").replace("/", "_")
        columns = [column_of(name, *each) for each in _WRENCH]
        notes.append(f"{topic} -> columns {columns[0]}, ..., {columns[-1]}, which no run plays")
        found += [Extra(columns[k], _WRENCH[k][1], t_ns, values[:, k]) for k in range(len(columns))]
    return tuple(found), notes


def _in_order(rows: Rows, topic: str) -> tuple[Ints, Array, list[str]]:
    t_ns, values = rows.arrays()
    notes = []
    if rows.n_undecodable:
        notes.append(f"{topic}: {rows.n_undecodable} messages cannot be read and are left out")
    if rows.n_unstamped:
        notes.append(f"{topic}: {rows.n_unstamped} messages hold no instant; that of the recorder counts")
    n_back = int(np.count_nonzero(np.diff(t_ns) < 0))
    unique, first = np.unique(t_ns, return_index=True)
    if n_back:
        notes.append(f"{topic}: {n_back} messages are earlier than the one before; they are sorted")
    if len(unique) < len(t_ns):
        notes.append(f"{topic}: {len(t_ns) - len(unique)} messages repeat an instant and are left out")
    return unique, values[first], notes
