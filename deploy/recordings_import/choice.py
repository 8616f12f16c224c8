"""Choice of topics: those that the user names, else those with CRTK's names of the da Vinci's devices. Pure."""

import re
from collections.abc import Mapping, Sequence
from typing import Final

from tis.common.errors import DataError, Fault, InputError
from tis.deploy.recordings_import.found import DEVICES, MASTERS, Kind, Topic, Wanted

_POSES: Final = ("measured_cp", "setpoint_cp", "servo_cp", "local/measured_cp")
_ARM_POSES: Final = ("setpoint_cp", "servo_cp", "measured_cp", "local/measured_cp")
_JAWS: Final = ("gripper/measured_js", "jaw/measured_js", "jaw/setpoint_js")
_ARM_JAWS: Final = ("jaw/setpoint_js", "jaw/measured_js", "gripper/measured_js")
_MAX_LISTED: Final = 40


def chosen(topics: Sequence[Topic], wanted: Wanted, where: str) -> tuple[dict[str, str], dict[str, str]]:
    """Return the topic of poses, and of gripper angles, of each device.

    Of an arm the commanded pose counts, as truth is the commanded pose; of a master the measured one. Raises
    `InputError` for topics that are not there or of another kind, `DataError` when no topic is found. Oracle: lists
    of topics in the tests.
    """
    by_name = {topic.name: topic for topic in topics}
    faults = [
        *_faults(wanted.topics, by_name, "pose", "--topic"),
        *_faults(wanted.jaws, by_name, "joints", "--jaw"),
    ]
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
    if not poses:
        rule = "has no topic of poses like /MTML/measured_cp or /PSM2/setpoint_cp; --topic DEVICE=TOPIC names one"
        listed = ", ".join(f"{topic.name} ({topic.type})" for topic in topics[:_MAX_LISTED]) or "none"
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
        if name not in topics:
            near = ", ".join(topic for topic, of in topics.items() if of.kind == kind) or "none"
            found.append(Fault("tis import", option, f"must be a topic of the file; of {words[kind]}: {near}", name))
        elif topics[name].kind != kind:
            found.append(Fault("tis import", option, f"must be a topic of {words[kind]}", f"{topics[name].type}"))
    return found


def _first(topics: Sequence[Topic], device: str, endings: Sequence[str], kind: Kind) -> str | None:
    for ending in endings:
        pattern = re.compile(rf"(.*/)?{device}/{ending}", re.IGNORECASE)
        there = [t.name for t in topics if t.kind == kind and t.n_messages and pattern.fullmatch(t.name)]
        if there:
            return min(there, key=len)
    return None
