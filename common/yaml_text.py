"""A safe subset of YAML for settings: one document, unique keys, bounded depth and size.

Anything else is refused before an object is built. The check reads the parser's events one by one, so that a text
made to exhaust memory or stack (200 000 brackets crash the C loader) does no harm.
"""

from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple, NoReturn

import yaml
from yaml.events import (
    AliasEvent,
    CollectionEndEvent,
    CollectionStartEvent,
    Event,
    MappingStartEvent,
    NodeEvent,
    ScalarEvent,
)

from tis.common.errors import Fault, InputError

MAX_YAML_BYTES: Final = 4_000_000
"""Size of a text; the largest profiles of samples take some 10 kB."""

_MAX_DEPTH: Final = 50
_MAX_VALUES: Final = 100_000  # with every alias expanded
_MAX_SCALAR_CHARS: Final = 2_000  # Python refuses to print integers of more than 4300 digits


def load_yaml(text: str, where: str) -> Any:
    """Return the value of a YAML text; raises `InputError`, with the line, for any text that cannot be read."""
    if len(text) > MAX_YAML_BYTES:
        raise InputError(Fault(where, "", f"must have at most {MAX_YAML_BYTES} characters", len(text)))
    try:
        check = _Check(where)
        for event in yaml.parse(text, Loader=yaml.CSafeLoader):
            check.take(event)
        return yaml.load(text, Loader=yaml.CSafeLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        line = f"line {mark.line + 1}" if mark else ""
        raise InputError(Fault(where, line, f"not YAML: {error.problem}")) from None
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        # malformed numbers and dates, like 0x_ and 2001-02-30, and characters that YAML excludes
        reason, _, _ = str(error).partition("\n")
        raise InputError(Fault(where, "", f"not YAML: {reason}")) from None


def line_of(text: str, field: str) -> int | None:
    """Return the line, from 1, of a field ``a.b.0.c`` in a text that `load_yaml` reads, or of what it would stand in.

    A key may have dots itself. None if the text has none of it.
    """
    node, line, steps = yaml.compose(text, Loader=yaml.CSafeLoader), None, field.split(".")
    while steps:
        found = None
        if isinstance(node, yaml.MappingNode):
            values = {key.value: (key, value) for key, value in node.value if isinstance(key, yaml.ScalarNode)}
            heads = (n for n in range(len(steps), 0, -1) if ".".join(steps[:n]) in values)
            if n_taken := next(heads, 0):
                found = values[".".join(steps[:n_taken])]
        elif isinstance(node, yaml.SequenceNode) and steps[0].isdecimal() and int(steps[0]) < len(node.value):
            found, n_taken = (node.value[int(steps[0])],) * 2, 1
        if found is None:
            break
        line, node, steps = found[0].start_mark.line + 1, found[1], steps[n_taken:]
    return line


class _Shape(NamedTuple):
    """Size (number of values) and nesting depth of a complete node, with every alias expanded."""

    size: int = 1
    depth: int = 0


@dataclass
class _Open:
    """A collection whose end event is still to come."""

    start: CollectionStartEvent
    size: int = 1
    depth: int = 1
    n_nodes: int = 0
    keys: set[str] = field(default_factory=set)


@dataclass
class _Check:
    """Checks the events of a text one by one; raises `InputError` for features that settings do not need."""

    where: str
    opened: list[_Open] = field(default_factory=list)
    anchored: dict[str, _Shape] = field(default_factory=dict)

    def take(self, event: Event) -> None:
        if isinstance(event, CollectionStartEvent | ScalarEvent) and event.tag is not None:
            self.refuse(event, f"the tag {event.tag!r} is not allowed")
        if isinstance(event, CollectionStartEvent):
            self.opened.append(_Open(event))
            if len(self.opened) > _MAX_DEPTH:
                self.refuse(event, f"must be nested at most {_MAX_DEPTH} levels deep")
        elif isinstance(event, CollectionEndEvent):
            closed = self.opened.pop()
            self.complete(closed.start, _Shape(closed.size, closed.depth))
        elif isinstance(event, ScalarEvent):
            if len(event.value) > _MAX_SCALAR_CHARS:
                self.refuse(event, f"a value must have at most {_MAX_SCALAR_CHARS} characters")
            self.complete(event, _Shape())
        elif isinstance(event, AliasEvent):
            if any(event.anchor == above.start.anchor for above in self.opened):
                self.refuse(event, f"{event.anchor!r} must not contain itself")
            # the loader reports an anchor that does not exist
            self.complete(event, self.anchored.get(event.anchor or "", _Shape()))

    def complete(self, node: NodeEvent, shape: _Shape) -> None:
        """Add a complete node to the collection around it."""
        if node.anchor is not None:
            self.anchored[node.anchor] = shape
        if not self.opened:
            return
        around = self.opened[-1]
        around.size += shape.size
        around.depth = max(around.depth, shape.depth + 1)
        if around.size > _MAX_VALUES:
            self.refuse(node, f"must have at most {_MAX_VALUES} values, with every alias expanded")
        if len(self.opened) + shape.depth > _MAX_DEPTH:
            self.refuse(node, f"must be nested at most {_MAX_DEPTH} levels deep")
        # the nodes of a mapping are key, value, key, value ...
        is_key = isinstance(around.start, MappingStartEvent) and around.n_nodes % 2 == 0
        around.n_nodes += 1
        if is_key and isinstance(node, ScalarEvent):
            if node.value in around.keys:
                self.refuse(node, f"key {node.value!r} must appear only once")
            around.keys.add(node.value)

    def refuse(self, event: Event, rule: str) -> NoReturn:
        mark = event.start_mark
        raise InputError(Fault(self.where, f"line {mark.line + 1}" if mark else "", rule))
