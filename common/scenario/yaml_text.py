"""YAML as people write settings: one document, each key once, bounded in depth and size.

Everything that YAML can do beyond that is refused before an object is built. The parser's events come one
by one, so a text that is meant to exhaust the memory or the stack (the C loader dies of 200 000 brackets)
costs nothing.
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

from common.errors import Fault, InputError

_DEEPEST: Final = 50
_LARGEST: Final = 100_000  # values, with every alias written out
_LONGEST_SCALAR: Final = 2_000  # Python refuses to print integers of more than 4300 digits


def load_yaml(text: str, where: str) -> Any:
    """Return the value of a YAML text, or raise `InputError` with the line, whatever the text is."""
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
        # what only looks like a number or a date, as 0x_ and 2001-02-30 do; characters that YAML excludes
        reason, _, _ = str(error).partition("\n")
        raise InputError(Fault(where, "", f"not YAML: {reason}")) from None


class _Shape(NamedTuple):
    """Of a complete node, with every alias in it written out: how many values, and how deeply nested."""

    size: int = 1
    depth: int = 0


@dataclass
class _Open:
    """A collection whose end has not come yet."""

    start: CollectionStartEvent
    size: int = 1
    depth: int = 1
    n_nodes: int = 0
    keys: set[str] = field(default_factory=set)


@dataclass
class _Check:
    """Takes the events of a text one by one; raises `InputError` for what a settings file has no use for."""

    where: str
    opened: list[_Open] = field(default_factory=list)
    anchored: dict[str, _Shape] = field(default_factory=dict)

    def take(self, event: Event) -> None:
        if isinstance(event, CollectionStartEvent | ScalarEvent) and event.tag is not None:
            self.refuse(event, f"the tag {event.tag!r} is not allowed")
        if isinstance(event, CollectionStartEvent):
            self.opened.append(_Open(event))
            if len(self.opened) > _DEEPEST:
                self.refuse(event, f"nested deeper than {_DEEPEST} levels")
        elif isinstance(event, CollectionEndEvent):
            closed = self.opened.pop()
            self.complete(closed.start, _Shape(closed.size, closed.depth))
        elif isinstance(event, ScalarEvent):
            if len(event.value) > _LONGEST_SCALAR:
                self.refuse(event, f"a value of more than {_LONGEST_SCALAR} characters")
            self.complete(event, _Shape())
        elif isinstance(event, AliasEvent):
            if any(event.anchor == above.start.anchor for above in self.opened):
                self.refuse(event, f"{event.anchor!r} contains itself")
            # an anchor that does not exist is left to the loader, which names it
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
        if around.size > _LARGEST:
            self.refuse(node, f"more than {_LARGEST} values")
        if len(self.opened) + shape.depth > _DEEPEST:
            self.refuse(node, f"nested deeper than {_DEEPEST} levels")
        is_key = isinstance(around.start, MappingStartEvent) and around.n_nodes % 2 == 0
        around.n_nodes += 1
        if is_key and isinstance(node, ScalarEvent):
            if node.value in around.keys:
                self.refuse(node, f"key {node.value!r} stands twice")
            around.keys.add(node.value)

    def refuse(self, event: Event, rule: str) -> NoReturn:
        mark = event.start_mark
        raise InputError(Fault(self.where, f"line {mark.line + 1}" if mark else "", rule))
