"""Where else in a format a key exists that was written in a wrong place."""

import difflib
from collections.abc import Iterator
from functools import cache
from typing import Final

from pydantic import BaseModel

from common.scenario.annotations import bare, is_model, variants

_MOST_PLACES: Final = 3
_CLOSE: Final = 0.8


def hint_elsewhere(path: tuple[str, ...], model: type[BaseModel]) -> str:
    """Return ``, did you mean ...?`` with the places of a key of the path's last name, else of one close to it.

    Nothing where there is none, where there are so many that they tell nothing, and where the very path exists, but
    for another kind of what it lies in. Oracle: places known by hand, tests/common/scenario/test_elsewhere.
    """
    places = _places(model)
    name = path[-1]
    near = [name] if name in places else difflib.get_close_matches(name, places, n=1, cutoff=_CLOSE)
    found = places[near[0]] if near else ()
    if not found or len(found) > _MOST_PLACES or path in found:
        return ""
    words = [f"{'.'.join(place)!r}" + (" at the top level" if len(place) == 1 else "") for place in found]
    return f", did you mean {' or '.join(words)}?"


@cache
def _places(model: type[BaseModel]) -> dict[str, tuple[tuple[str, ...], ...]]:
    """Return the paths of all keys by their last name; what lies within a list has no path of its own."""
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
