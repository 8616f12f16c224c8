"""Poses from an MCAP file of any program: `tis` logs, JSON, and messages of ROS 2 in CDR."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from mcap.records import Channel

from tis.common.errors import DataError, Fault
from tis.common.runtime.chunk_writer import by_channel
from tis.deploy.logs.describe import Described, describe
from tis.deploy.logs.log_file import LogFile
from tis.deploy.logs.payloads import UNREADABLE, json_value
from tis.deploy.recordings_import.choice import chosen, listing
from tis.deploy.recordings_import.found import Found, Rows, Topic, Wanted
from tis.deploy.recordings_import.gathered import streams_of
from tis.deploy.recordings_import.pose_messages import (
    jaw_in_json,
    jaw_in_ros,
    kind_of_json,
    kind_of_type,
    pose_in_json,
    pose_in_ros,
)
from tis.deploy.recordings_import.ros import decoder

Read = Callable[[bytes, int], tuple[int, tuple[float, ...], bool]]
_POSE_WIDTH: Final = 8
_SAMPLED: Final = 50


def read_mcap(path: Path, wanted: Wanted) -> Found:
    """Return the poses of an MCAP file; raises `DataError` for a damaged one, and as `chosen` does.

    Nothing is imported of a damaged file: `tis recover` says what is lost. Oracle: files that the tests write.
    """
    found = describe(path)
    if found.log.damage is not None:
        advice = f"`tis recover {path}` copies what can be read to a new file"
        raise DataError(Fault(str(path), "", f"is damaged: {found.log.damage}; {advice}"))
    first = _first_payloads(path)
    topics = [_topic(found, channel, first.get(number, ())) for number, channel in found.log.channels.items()]
    merged: dict[str, Topic] = {}
    for topic in topics:  # a topic may have several channels
        before = merged.get(topic.name)
        n_before = 0 if before is None else before.n_messages
        kind = topic.kind or (None if before is None else before.kind)
        merged[topic.name] = Topic(topic.name, topic.type, topic.n_messages + n_before, kind)
    poses, jaws = chosen(list(merged.values()), wanted, str(path))
    rows = _rows(path, found, poses, jaws)
    streams, angles, notes = streams_of(poses, jaws, rows, str(path), wanted.skips_unreadable)
    about: dict[str, Any] = {"kind": "mcap"}
    return Found(streams, angles, (*listing(list(merged.values()), poses, jaws), *notes), about)


def _first_payloads(path: Path) -> dict[int, list[bytes]]:
    """Return the first messages of each channel, by which JSON is recognised."""
    found: dict[int, list[bytes]] = {}
    for block in LogFile(path).blocks():
        for number, which in by_channel(block.channel):
            there = found.setdefault(number, [])
            there += block.payloads(which[: _SAMPLED - len(there)])
    return found


def _topic(found: Described, channel: Channel, first: Any) -> Topic:
    schema = found.log.schemas.get(channel.schema_id)
    name = channel.message_encoding if schema is None or not schema.name else schema.name
    kind = kind_of_type(name) if channel.message_encoding == "cdr" else None
    if channel.message_encoding == "json":
        kinds = {_kind_of(payload) for payload in first}
        kind = next((each for each in ("pose", "joints") if each in kinds), None)
    return Topic(channel.topic, name, found.counts[channel.id], kind)


def _kind_of(payload: bytes) -> Any:
    try:
        return kind_of_json(json_value(payload))
    except UNREADABLE:
        return None


def _rows(path: Path, found: Described, poses: Mapping[str, str], jaws: Mapping[str, str]) -> dict[str, Rows]:
    rows = {name: Rows(_POSE_WIDTH) for name in poses.values()} | {name: Rows(1) for name in jaws.values()}
    readers = {
        number: _reader(found, channel, channel.topic in poses.values())
        for number, channel in found.log.channels.items()
        if channel.topic in rows
    }
    log = LogFile(path)
    for block in log.blocks():
        for number, which in by_channel(block.channel):
            if number not in readers:
                continue
            into, read = rows[log.topic(number)], readers[number]
            for payload, log_ns in zip(block.payloads(which), block.log_ns[which].tolist(), strict=True):
                try:
                    t_ns, values, is_stamped = read(payload, log_ns)
                    into.append(t_ns, values)
                except UNREADABLE:
                    into.n_undecodable += 1
                else:
                    into.n_unstamped += not is_stamped
    return rows


def _reader(found: Described, channel: Channel, is_pose: bool) -> Read:
    """Return a function of a payload and its log time; it raises one of `UNREADABLE`."""
    if channel.message_encoding == "json":
        if is_pose:
            return lambda payload, log_ns: pose_in_json(json_value(payload), log_ns)
        return lambda payload, log_ns: _one(jaw_in_json(json_value(payload), log_ns))
    schema = found.log.schemas[channel.schema_id]
    decode = decoder(schema.name)
    if is_pose:
        return lambda payload, log_ns: pose_in_ros(decode(payload), log_ns)
    return lambda payload, log_ns: _one(jaw_in_ros(decode(payload), log_ns))


def _one(read: tuple[int, float, bool]) -> tuple[int, tuple[float, ...], bool]:
    t_ns, value, is_stamped = read
    return t_ns, (value,), is_stamped
