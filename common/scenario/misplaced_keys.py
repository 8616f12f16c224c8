"""Hints for a key that was written in the wrong place: the places where the format has it."""

import difflib
from collections.abc import Iterator
from functools import cache
from typing import Final

from pydantic import BaseModel

from common.scenario.annotations import bare, is_model, variants

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
