"""Rows of a profile's numbers: one per distribution, and one for both directions where they are equal."""

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from tis.common.scenario.profile import Number, Profile, numeric_paths

_POINTS: Final = "points"
_WAYS: Final = ("forward", "feedback")

Path = tuple[str, ...]


class NumberRow(NamedTuple):
    """One row: path, value, and the profile's entry with source and basis."""

    of: str
    value: str
    number: Number


def number_rows(profile: Profile) -> list[NumberRow]:
    """Return the rows of a profile in its order; every number belongs to exactly one row."""
    network = profile.partial()
    alike = _alike(profile, network)
    grouped: dict[tuple[Path, int], tuple[Number, list[Path]]] = {}
    for path in numeric_paths(network):
        number = profile.basis_of(path)
        if number is None or (alike and path[0] == "feedback"):
            continue
        base = path[: path.index(_POINTS) + 1] if _POINTS in path else path
        grouped.setdefault((base, profile.numbers.index(number)), (number, []))[1].append(path)
    return [_row(base, number, paths, network, alike) for (base, _), (number, paths) in grouped.items()]


def _alike(profile: Profile, network: Mapping[str, Any]) -> bool:
    """Tell whether both directions have equal values with equal sources."""
    forward, feedback = (network.get(way) for way in _WAYS)
    if forward != feedback or not forward:
        return False
    return all(
        profile.basis_of(("forward", *path)) == profile.basis_of(("feedback", *path))
        for path in numeric_paths(forward)
    )


def _row(base: Path, number: Number, paths: list[Path], network: Mapping[str, Any], alike: bool) -> NumberRow:
    of = ("both", *base[1:]) if alike and base[0] in _WAYS else base
    if base[-1] != _POINTS:
        return NumberRow(".".join(of), f"{_value(network, base):g}", number)
    places = sorted({int(path[len(base)]) for path in paths})
    points = [_value(network, (*base, str(place))) for place in places]
    if len(points) == 1:
        return NumberRow(".".join((*of, str(places[0]))), _point(points[0]), number)
    return NumberRow(".".join(of), f"{len(points)} points, {_point(points[0])} to {_point(points[-1])}", number)


def _point(point: Mapping[str, float]) -> str:
    return f"p {point['p']:g}: {point['delay_ms']:g} ms"


def _value(tree: Any, path: Path) -> Any:
    for step in path:
        tree = tree[int(step)] if isinstance(tree, list) else tree[step]
    return tree
