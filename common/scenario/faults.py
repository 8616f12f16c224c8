"""Translation of pydantic's validation errors into faults with the field paths of the file."""

import difflib
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Final, NamedTuple, TypeGuard, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from tis.common.errors import Fault


def variants(annotation: Any) -> dict[str, type[BaseModel]]:
    """Return the alternative models of a field by their ``kind``, or by class name where they have none."""
    is_union = get_origin(annotation) in (Union, UnionType)
    members = [bare(member) for member in (get_args(annotation) if is_union else (annotation,))]
    named: dict[str, type[BaseModel]] = {}
    for member in members:
        if is_model(member) and "kind" in member.model_fields:
            named |= dict.fromkeys(get_args(member.model_fields["kind"].annotation), member)
        elif is_model(member) and is_union:
            named[member.__name__] = member
    return named


def bare(annotation: Any) -> Any:
    """Return an annotation without ``Annotated`` and ``| None``."""
    while True:
        if get_origin(annotation) is Annotated:
            annotation = get_args(annotation)[0]
            continue
        if get_origin(annotation) in (Union, UnionType):
            members = [member for member in get_args(annotation) if member is not NoneType]
            if len(members) == 1:
                annotation = members[0]
                continue
        return annotation


def is_model(annotation: Any) -> TypeGuard[type[BaseModel]]:
    """Tell whether an annotation is a model."""
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


# Hints for a key that was written in the wrong place: the places where the format has it.

_MAX_PLACES: Final = 3  # more alternatives do not help the reader
_MIN_SIMILARITY: Final = 0.8


def misplaced_key_hint(path: tuple[str, ...], model: type[BaseModel]) -> str:
    """Return ``, did you mean ...?`` with the paths of keys whose name equals or resembles the last one of ``path``.

    Empty where there are none or too many, and where the path itself exists but belongs to another kind. Oracle:
    places known by hand, tests/common/scenario/test_misplaced_keys.
    """
    places = _places(model)
    name = path[-1]
    near = [name] if name in places else difflib.get_close_matches(name, places, n=1, cutoff=_MIN_SIMILARITY)
    found = places[near[0]] if near else ()
    if not found or len(found) > _MAX_PLACES or path in found:
        return ""
    words = [f"{'.'.join(place)!r}" + (" at the top level" if len(place) == 1 else "") for place in found]
    return f", did you mean {' or '.join(words)}?"


@cache
def _places(model: type[BaseModel]) -> dict[str, tuple[tuple[str, ...], ...]]:
    """Return the paths of all keys by their last name; keys within lists have none."""
    found: dict[str, dict[tuple[str, ...], None]] = {}
    for path in _walk(model, (), ()):
        found.setdefault(path[-1], {})[path] = None
    return {name: tuple(paths) for name, paths in found.items()}


def _walk(
    model: type[BaseModel], path: tuple[str, ...], above: tuple[type[BaseModel], ...]
) -> Iterator[tuple[str, ...]]:
    for name, field in model.model_fields.items():
        here = (*path, name)
        yield here
        annotation = bare(field.annotation)
        parts = (annotation,) if is_model(annotation) else tuple(variants(annotation).values())
        for part in parts:
            if part not in above:
                yield from _walk(part, here, (*above, model))


_RULES: Final = {
    "missing": "is required",
    "invalid_key": "keys must be text",
    "model_type": "must be a mapping of keys to values",
    "model_attributes_type": "must be a mapping with a kind",
    "tuple_type": "must be a list",
    "string_type": "must be text",
    "int_type": "must be an integer",
    "int_parsing": "must be an integer",
    "int_from_float": "must be an integer",
    "float_type": "must be a number",
    "float_parsing": "must be a number",
    "finite_number": "must be a finite number",
    "literal_error": "must be {expected}",
    "greater_than": "must be greater than {gt:g}",
    "greater_than_equal": "must be at least {ge:g}",
    "less_than": "must be less than {lt:g}",
    "less_than_equal": "must be at most {le:g}",
    "string_too_short": "must have at least {min_length} character{s}",
    "string_too_long": "must have at most {max_length} character{s}",
    "too_short": "must have at least {min_length} item{s}",
    "too_long": "must have at most {max_length} item{s}",
}
_SAME: Final = {"west": "forward", "east": "feedback", "west_to_east": "forward", "east_to_west": "feedback"}
"""Other names of a direction: by the origin of its messages, or by both ends."""

_QUOTED: Final = re.compile(r"'([^']*)'")
_TIMES_OF_A_QUEUE: Final = tuple(
    ("queue", name) for name in ("max_ms", "max_delay_ms", "limit_ms", "max_s", "latency_ms")
)
_ONE_BY_ONE = ": set it in forward and in feedback"
_AS_BYTES: Final = (
    ", did you mean max_bytes? A queue of so many ms has ms x kbit_s / 8 (250 ms at 5000 kbit/s: 156250)"
)
_MAX_NAMED: Final = 200  # of faults; each takes a search for the key that was meant
_BAD_KIND: Final = ("union_tag_invalid", "union_tag_not_found")


class _Place(NamedTuple):
    """A position: the path as the file has it, the annotation there, the keys allowed beside it."""

    path: tuple[str, ...]
    annotation: Any
    siblings: tuple[str, ...]


def faults(error: ValidationError, model: type[BaseModel], where: str) -> list[Fault]:
    """Return one fault for each rule that the input of ``model`` breaks; ``where`` names the file.

    Of very many the first are named and the others counted.
    """
    details = [detail for detail in error.errors() if not _is_echo(detail)]
    found = [fault for detail in details[:_MAX_NAMED] for fault in _faults(detail, model, where)]
    n_more = len(details) - _MAX_NAMED
    return [*found, Fault(where, "", f"and {n_more} more faults")] if n_more > 0 else found


def _is_echo(detail: ErrorDetails) -> bool:
    """Tell whether a list is reported as too short only because its invalid items, reported already, do not count."""
    return detail["type"] == "too_short" and len(detail["input"]) >= detail["ctx"]["min_length"]


def _faults(detail: ErrorDetails, model: type[BaseModel], where: str) -> list[Fault]:
    place = _locate(detail["loc"], model)
    field, kind, got = ".".join(place.path), detail["type"], detail["input"]
    # Faults about keys and kinds, which need hints.
    if kind == "extra_forbidden":
        hint = meant(str(detail["loc"][-1]), place.siblings) or misplaced_key_hint(place.path, model)
        hint = _AS_BYTES if place.path[-2:] in _TIMES_OF_A_QUEUE else hint
        hint = _ONE_BY_ONE if detail["loc"][-1] == "both" and "forward" in place.siblings else hint
        return [Fault(where, field, f"unknown key{hint}", got)]
    if kind in _BAD_KIND:
        field = ".".join((*place.path, "kind"))
        names = tuple(variants(place.annotation))
        kinds = " or ".join(map(repr, names))
        if isinstance(got, Mapping) and "kind" in got:
            return [Fault(where, field, f"must be {kinds}{meant(got['kind'], names)}", got["kind"])]
        return [Fault(where, field, f"is required ({kinds})")]
    # Faults about values: the rule in our words where there is one, else in pydantic's.
    if kind == "value_error":
        # raised by the scenario's own validators, one line per broken rule
        rules = str(detail["ctx"]["error"]).splitlines()
    else:
        context = detail.get("ctx", {})
        plural = "" if 1 in (context.get("min_length"), context.get("max_length")) else "s"
        rules = [_RULES[kind].format(**context, s=plural) if kind in _RULES else detail["msg"]]
    if kind == "literal_error":
        rules = [f"{rule}{meant(got, re.findall(_QUOTED, rule))}" for rule in rules]
    # Neither an absent value nor a whole part of the scenario is shown as "got".
    if kind == "missing" or isinstance(got, Mapping | BaseModel):
        return [Fault(where, field, rule) for rule in rules]
    return [Fault(where, field, rule, got) for rule in rules]


def meant(got: object, allowed: Sequence[str]) -> str:
    """Return ``, did you mean ...?`` with the allowed words that resemble ``got``, or have it as a part, if any."""
    if not isinstance(got, str):
        return ""
    same = _SAME.get(got)
    near = [same] if same in allowed else difflib.get_close_matches(got, allowed, n=2, cutoff=0.7)
    near = near or [each for each in allowed if got in each.split("_")][:2]
    return f", did you mean {' or '.join(map(repr, near))}?" if near else ""


def _locate(loc: Sequence[int | str], model: type[BaseModel]) -> _Place:
    """Follow pydantic's location through the annotations.

    Where a field has variants, pydantic inserts the name of the chosen one into the path; files have no such step.
    """
    path: list[str] = []
    siblings: tuple[str, ...] = ()
    here: Any = model
    chosen: dict[str, Any] = {}
    for step in loc:
        if chosen:
            here, chosen = chosen.get(str(step)), {}
            continue
        if step == "[key]" and path:  # the fault is in the key before it
            continue
        path.append(text if (text := str(step)).isprintable() else repr(text))
        if get_origin(here) is tuple:
            here = bare(get_args(here)[0])
        elif get_origin(here) is dict:
            here = bare(get_args(here)[1])
        else:
            fields = here.model_fields if is_model(here) else {}
            siblings = tuple(fields)
            here = bare(fields[str(step)].annotation) if str(step) in fields else None
        chosen = variants(here)
    return _Place(tuple(path), here, siblings)
