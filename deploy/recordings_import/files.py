"""Poses from an MCAP file of any program (`tis` logs, JSON, and messages of ROS 2 in CDR), and from bags of ROS."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from mcap.records import Channel

from tis.common.errors import DataError, Fault, InputError
from tis.common.runtime.chunk_writer import by_channel
from tis.common.runtime.process import command_line
from tis.deploy.logs.describe import Described, describe
from tis.deploy.logs.log_file import LogFile
from tis.deploy.logs.payloads import UNREADABLE, json_value
from tis.deploy.recordings_import.choice import chosen, listing, streams_of, wrenches_of
from tis.deploy.recordings_import.found import Found, Rows, Topic, Wanted, rows_of
from tis.deploy.recordings_import.messages import (
    Read,
    check_rosbags,
    decoder,
    holds_frames,
    in_json,
    in_ros,
    kind_of_json,
    kind_of_type,
    pairs_in,
)

_SAMPLED: Final = 50

# Transforms between frames: each pair of a topic of TF is a topic of poses of its own, like /tf:odom:base_link. Pairs
# are those that were sent; a chain like map, odom, base_link is not multiplied out.

_MAX_PAIRS: Final = 1000

Decode = Callable[[], Any]
"""Returns a decoded message; raises one of `UNREADABLE`."""


def pair_topics(topic: str, type_name: str, messages: Iterable[Decode]) -> list[Topic]:
    """Return the pairs of frames in a topic's messages, in order; those that cannot be read name none."""
    counts: Counter[str] = Counter()
    for decode in messages:
        try:
            found = pairs_in(topic, decode())
        except (*UNREADABLE, AssertionError):
            continue
        for pair, transforms in found.items():
            if pair in counts or len(counts) < _MAX_PAIRS:
                counts[pair] += len(transforms)
    return [Topic(pair, type_name, n, "pose") for pair, n in counts.items()]


def take_pairs(topic: str, decode: Decode, log_ns: int, rows: Mapping[str, Rows]) -> None:
    """Add the transforms of a message to the rows of their pairs; one that cannot be read counts for each pair."""
    try:
        found = pairs_in(topic, decode())
    except (*UNREADABLE, AssertionError):
        for name, into in rows.items():
            into.n_undecodable += name.startswith(f"{topic}:")
        return
    for pair, transforms in found.items():
        for one in transforms if pair in rows else ():
            rows[pair].take(partial(in_ros, one, log_ns, True))


def read_mcap(path: Path, wanted: Wanted) -> Found:
    """Return the poses of an MCAP file; raises `DataError` for a damaged one, and as `chosen` does.

    Nothing is imported of a damaged file: `tis recover` says what is lost. Oracle: files that the tests write.
    """
    found = describe(path)
    if found.log.damage is not None:
        advice = f"`{command_line(['recover', str(path)])}` copies what can be read to a new file"
        raise DataError(Fault(str(path), "", f"is damaged: {found.log.damage}; {advice}"))
    first = _first_payloads(path)
    topics = [_topic(found, channel, first.get(number, ())) for number, channel in found.log.channels.items()]
    merged: dict[str, Topic] = {}
    for topic in topics:  # a topic may have several channels
        before = merged.get(topic.name)
        n_before = 0 if before is None else before.n_messages
        kind = topic.kind or (None if before is None else before.kind)
        merged[topic.name] = Topic(topic.name, topic.type, topic.n_messages + n_before, kind)
    for pair in _pairs(path, found):
        merged[pair.name] = pair
    poses, jaws = chosen(list(merged.values()), wanted, str(path))
    rows = _rows(path, found, rows_of(poses, jaws, merged.values()))
    streams, angles, notes = streams_of(poses, jaws, rows, str(path), wanted.skips_unreadable)
    about: dict[str, Any] = {"kind": "mcap"}
    extras, more_notes = wrenches_of(rows)
    notes = [*listing(list(merged.values()), poses, jaws), *notes, *more_notes]
    return Found(streams, angles, tuple(notes), about, extras=extras)


def _first_payloads(path: Path) -> dict[int, list[bytes]]:
    """Return the first messages of each channel, by which JSON is recognised."""
    found: dict[int, list[bytes]] = {}
    for block in LogFile(path).blocks():
        for number, which in by_channel(block.channel):
            there = found.setdefault(number, [])
            there += block.payloads(which[: _SAMPLED - len(there)])
    return found


def _of_frames(found: Described) -> dict[int, str]:
    """Return the channels of transforms between frames, with the names of their types."""
    of_ros = [(number, c) for number, c in found.log.channels.items() if c.message_encoding == "cdr"]
    names = {n: found.log.schemas[c.schema_id].name for n, c in of_ros if c.schema_id in found.log.schemas}
    return {number: name for number, name in names.items() if holds_frames(name)}


def _pairs(path: Path, found: Described) -> list[Topic]:
    pairs = []
    for number, name in _of_frames(found).items():
        decode = decoder(name)
        blocks = ((block, np.flatnonzero(block.channel == number)) for block in LogFile(path).blocks())
        messages = (partial(decode, payload) for block, which in blocks for payload in block.payloads(which))
        pairs += pair_topics(found.log.channels[number].topic, name, messages)
    return pairs


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


def _rows(path: Path, found: Described, rows: dict[str, Rows]) -> dict[str, Rows]:
    """Fill the rows with the file's messages."""
    readers = {
        number: _reader(found, channel, rows[channel.topic].is_poses)
        for number, channel in found.log.channels.items()
        if channel.topic in rows
    }
    frames = {number: decoder(name) for number, name in _of_frames(found).items()}
    log = LogFile(path)
    for block in log.blocks():
        for number, which in by_channel(block.channel):
            if number in frames:
                for payload, log_ns in zip(block.payloads(which), block.log_ns[which].tolist(), strict=True):
                    take_pairs(log.topic(number), partial(frames[number], payload), log_ns, rows)
            if number in readers:
                into, read = rows[log.topic(number)], readers[number]
                for payload, log_ns in zip(block.payloads(which), block.log_ns[which].tolist(), strict=True):
                    into.take(partial(read, payload, log_ns))
    return rows


def _reader(found: Described, channel: Channel, is_pose: bool) -> Callable[[bytes, int], Read]:
    """Return a function of a payload and its log time; it raises one of `UNREADABLE`."""
    if channel.message_encoding == "json":
        return lambda payload, log_ns: in_json(json_value(payload), log_ns, is_pose)
    schema = found.log.schemas.get(channel.schema_id)
    if channel.message_encoding != "cdr" or schema is None:  # another channel of the topic can be read
        return _unknown
    decode = decoder(schema.name)
    return lambda payload, log_ns: in_ros(decode(payload), log_ns, is_pose)


def _unknown(payload: bytes, log_ns: int) -> Read:  # noqa: ARG001  as every reader
    raise ValueError("a message without a schema, or in an encoding that is not read")


def read_bag(path: Path, wanted: Wanted) -> Found:
    """Return the poses of a rosbag2 (a folder with metadata.yaml; storage sqlite3 or mcap) or of a ROS 1 bag.

    Raises `InputError` without the package rosbags, `DataError` for a damaged bag, and as `chosen` does. Oracle: bags
    that the tests write.
    """
    check_rosbags()
    try:
        return _poses_in(path, wanted)
    except (DataError, InputError):
        raise
    except Exception as error:  # rosbags documents no closed set of errors for a damaged bag
        text = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise DataError(Fault(str(path), "", f"cannot be read as a bag: {text}")) from None


def _poses_in(path: Path, wanted: Wanted) -> Found:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        counts: dict[str, int] = {}
        types = {}
        for connection in reader.connections:
            counts[connection.topic] = counts.get(connection.topic, 0) + connection.msgcount
            types[connection.topic] = connection.msgtype
        topics = [Topic(name, types[name], n, kind_of_type(types[name])) for name, n in counts.items()]
        framed = [connection for connection in reader.connections if holds_frames(connection.msgtype)]
        for name in dict.fromkeys(connection.topic for connection in framed):
            sent = reader.messages([connection for connection in framed if connection.topic == name])
            messages = (partial(reader.deserialize, data, of.msgtype) for of, _, data in sent)
            topics += pair_topics(name, types[name], messages)
        poses, jaws = chosen(topics, wanted, str(path))
        rows = rows_of(poses, jaws, topics)

        def message_in(data: bytes, name: str, log_ns: int, is_pose: bool) -> Read:
            return in_ros(reader.deserialize(data, name), log_ns, is_pose)

        chosen_ones = [connection for connection in reader.connections if connection.topic in rows]
        for connection, log_ns, data in reader.messages([*chosen_ones, *framed]):
            if connection in framed:
                take_pairs(connection.topic, partial(reader.deserialize, data, connection.msgtype), log_ns, rows)
                continue
            into = rows[connection.topic]
            into.take(partial(message_in, data, connection.msgtype, log_ns, into.is_poses))
    streams, angles, notes = streams_of(poses, jaws, rows, str(path), wanted.skips_unreadable)
    extras, more_notes = wrenches_of(rows)
    notes = [*listing(topics, poses, jaws), *notes, *more_notes]
    return Found(streams, angles, tuple(notes), {"kind": "rosbag"}, extras=extras)
