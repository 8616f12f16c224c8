"""Page of the logs: their topics, read off the channel table and the records' models."""

import inspect
import re
from collections.abc import Iterator
from typing import Any, Literal, get_args, get_origin, get_type_hints

from from_code.markdown import code, prose, table
from from_code.sources import (
    MAX_JSON_BYTES,
    MAX_MODEL_BYTES,
    MAX_TRIAL_BYTES,
    MAX_YAML_BYTES,
    RECORD_MODULES,
    ROOT,
    SIDE_PACKAGES,
    TOPICS,
    Topic,
    channels,
    limits,
    unit_of,
)
from tis.common.messages import Message, meanings

_HEAD = """# Logs

Each side writes one MCAP file, `surgeon.mcap`, `netem.mcap` and `patient.mcap`; every record is JSON, and its schema
is in the file. Times are run time in ns. `run.mcap` holds the records of all three: there the topic `T` of a side is
`/SIDE/T`. `tis export` writes the same records as tables, `tis.deploy.report.load` returns them as [arrays](api.md).

## Messages

The messages between the sides, on the topic that is their Zenoh key; `SESSION` is the scenario's `session`.
The surgeon and the patient each log what they send and what they receive; netem logs no payload.
"""


_LIMITS = """## Limits

All commands read logs within limits, so that a damaged or hostile file takes no more memory and time than its size
admits. What exceeds a limit is damage: the part before it is read, `tis info` exits with code 4 and the reason, and
`tis recover` copies what it can. A record that is no record of its topic, or an instant of no run, is an error with
exit code 4. The limits are far beyond an hour at 1 kHz: 60 million messages in some 2 GB, in chunks of up to 1 MiB.
The same holds for the texts that the commands read.
"""


def page() -> str:
    """Return the page."""
    parts = [_HEAD, _channels(), ""]
    carried = dict.fromkeys(one.payload for _, one in _all_channels())
    parts += [text for model in carried for text in _fields(model, model.__name__, "")]
    parts += ["## Records", "", "What a side logs beside the messages.", ""]
    known = sorted(TOPICS.values())
    names = [topic.model.__name__ for topic in known]
    rows = [
        (code(topic), _writers(topic), f"[{name}](#{name.lower()})") for topic, name in zip(known, names, strict=True)
    ]
    parts += [table(("topic", "in the log of", "record"), rows), ""]
    parts += [text for topic in known for text in _fields(topic.model, topic.model.__name__, _key(topic))]
    return "\n".join([*parts, _limits()])


def _key(topic: Topic) -> str:
    return f"{topic}/NAME" if topic.is_group else str(topic)


def _limits() -> str:
    """Return the section on the limits of reading, as prose and a table."""
    rows = [
        ("a chunk, decompressed", f"{limits.MAX_CHUNK_BYTES >> 20} MiB"),
        ("records of a chunk", str(limits.MAX_CHUNK_RECORDS)),
        (
            "all chunks, decompressed",
            f"{limits.FREE_BYTES >> 20} MiB and {limits.MAX_EXPANSION} times the bytes of the file",
        ),
        ("all records", f"{limits.FREE_RECORDS} and one for each byte of the file"),
        ("a record of the file, as of an attachment", f"{limits.MAX_RECORD_BYTES // 10**6} MB"),
        ("a metadata record", f"{limits.MAX_METADATA_BYTES >> 20} MiB"),
        ("channels; schemas", f"{limits.MAX_CHANNELS}; {limits.MAX_SCHEMAS}"),
        ("attachments; metadata records", f"{limits.MAX_ATTACHMENTS}; {limits.MAX_METADATA}"),
        ("a payload that is decoded", f"{limits.MAX_JSON_BYTES >> 20} MiB of JSON, without NaN"),
        ("integers and instants in ns", f"{limits.MAX_NUMBER} either way, 146 years"),
        ("scenario or profile", f"{MAX_YAML_BYTES // 10**6} MB, 100000 values, 50 levels"),
        ("model file", f"{MAX_MODEL_BYTES // 10**6} MB"),
        ("`summary.json`, `manifest.json`", f"{MAX_JSON_BYTES // 10**6} MB"),
        ("trace; JIGSAWS trial", f"256 MB, 5 million rows; {MAX_TRIAL_BYTES // 10**6} MB, an hour"),
    ]
    return _LIMITS + "\n" + table(("what", "at most"), rows) + "\n"


def _channels() -> str:
    rows = [
        (
            code(channel.key("SESSION")),
            hand,
            channel.direction or ("west only" if channels.is_predicted(channel.key("SESSION")) else "east only"),
            f"[{channel.payload.__name__}](#{channel.payload.__name__.lower()})",
        )
        for hand, channel in _all_channels()
    ]
    return table(("key", "hand", "direction", "payload"), rows)


def _all_channels() -> list[tuple[str, Any]]:
    rows = [channels.hand_channels(hand, channels.FOLLOWER[hand]) for hand in get_args(channels.Hand)]
    return [(row.hand, one) for row in rows for one in _channels_of(row)] + [("", channels.VIDEO)]


def _channels_of(row: Any) -> tuple[Any, ...]:
    return row.command, row.arm, row.estimated, row.measured, row.driven, row.predicted


def _writers(topic: Topic) -> str:
    """Return the sides whose package imports the topic; a topic of the shared runtime is any side's."""
    names = [name for module in RECORD_MODULES for name, value in vars(module).items() if value is topic]
    found = [side for side, package in SIDE_PACKAGES.items() if _is_imported(names[0], package)]
    return ", ".join(found) or "any side"


def _is_imported(name: str, package: str) -> bool:
    modules = "|".join(re.escape(module.__name__) for module in RECORD_MODULES)
    pattern = re.compile(rf"from ({modules}) import [^)\n]*(\([^)]*)?\b{name}\b")
    return any(pattern.search(path.read_text(encoding="utf-8")) for path in sorted((ROOT / package).rglob("*.py")))


def _fields(model: type[Message], name: str, topic: str) -> Iterator[str]:
    yield f"### {name}\n"
    if topic:
        yield f"Topic `{topic}`.\n"
    yield "\n\n".join(prose(paragraph) for paragraph in (inspect.getdoc(model) or "").split("\n\n")) + "\n"
    types = get_type_hints(model)
    rows = [
        (code(field), _type(types[field]), unit_of(field), prose(meaning))
        for field, meaning in meanings(model).items()
    ]
    yield table(("field", "type", "unit", "meaning"), rows) + "\n"


def _type(annotation: Any) -> str:
    if get_origin(annotation) is Literal:
        return ", ".join(map(code, get_args(annotation)))
    members = [one for one in get_args(annotation) if one is not Ellipsis]
    if get_origin(annotation) is tuple:
        return f"list of {_type(members[0])}"
    if members and get_origin(annotation) is not None:
        return " or ".join(_type(one) for one in members)
    plain = {int: "integer", float: "number", str: "text", bool: "boolean", type(None): "null"}
    return plain.get(annotation, getattr(annotation, "__name__", str(annotation)))
