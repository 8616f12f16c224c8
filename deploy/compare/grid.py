"""Grids of settings: axes, each one field of the scenario at several values, and the points they span."""

import re
from dataclasses import dataclass
from itertools import product
from math import prod
from typing import Final, NamedTuple

import numpy as np

from tis.common.errors import Fault, InputError

COMMAND: Final = "tis compare"
_RANGE: Final = re.compile(r"(?P<first>[^:]+?)\.\.(?P<last>[^:]+):(?P<count>\d+)(?P<log>:log)?")
MAX_VALUES: Final = 10_000
_ONE_FOLDER: Final = "cannot be swept, as the trials are those of one source: compare twice"
_NOT_SWEPT: Final = {
    "seed": "cannot be swept: --seeds takes several",
    "duration_s": "cannot be swept: --duration-s bounds the length of all twins",
    "estimators": "cannot be swept: --estimators names all that are compared",
    "source": _ONE_FOLDER,
    "source.kind": _ONE_FOLDER,
    "source.path": _ONE_FOLDER,
    "source.task": _ONE_FOLDER,
    "source.trial": "cannot be swept: --trials names several",
}
MAX_POINTS: Final = 100_000


_WAYS: Final = {"forward": "to the patient", "feedback": "back"}
_UNITS: Final = {"ms": "ms", "s": "s", "hz": "Hz", "mm": "mm", "mps": "m/s", "kbit": "kbit", "mb": "MB", "pct": "%"}


def axis_words(path: str) -> str:
    """Return a field of the scenario in words: `network.forward.delay.delay_ms` is "delay to the patient, ms"."""
    *places, name = path.split(".")
    words = name.split("_")
    unit = f", {_UNITS[words.pop()]}" if len(words) > 1 and words[-1] in _UNITS else ""
    if words[0] == "p":
        words[0] = "probability of"
    stage = places[-1] if places and places[-1] not in (*_WAYS, "network") and not places[-1].isdigit() else ""
    if stage and stage not in words:
        words.insert(0, stage)
    way = next((f" {_WAYS[place]}" for place in places if place in _WAYS), "")
    return f"{' '.join(words)}{way}{unit}"


@dataclass(frozen=True)
class Sweep:
    """One field of the scenario at several values, as text: an axis of a grid."""

    path: str
    values: tuple[str, ...]


class Point(NamedTuple):
    """One combination of values: its ``label``, None without any axis, and the values by path."""

    label: str | None
    values: dict[str, str]

    @property
    def settings(self) -> tuple[str, ...]:
        """The values as settings, ``a.b=V``."""
        return tuple(f"{path}={value}" for path, value in self.values.items())


def parse_sweep(text: str) -> Sweep:
    """Return ``a.b=V,V,V`` as an axis; raises `InputError`.

    A value may be a range: ``0..500:11`` stands for 11 values, evenly spaced, and ``1..1000:4:log`` for 4 values of
    equal ratios. Oracle: numpy's linspace and geomspace.
    """
    path, equals, values = text.partition("=")
    found: list[str] = []
    for value in values.split(","):
        span = _RANGE.fullmatch(value.strip())
        found += [value.strip()] if span is None else _spanned(span, text)
    if not equals or not all(path.split(".")) or not all(found) or len(set(found)) < len(found):
        rule = "must read a.b=VALUE,VALUE,... with different values; FIRST..LAST:COUNT[:log] is a range"
        raise InputError(Fault(COMMAND, "--sweep", rule, text))
    return Sweep(path, tuple(found))


def _spanned(span: re.Match[str], text: str) -> list[str]:
    """Return the values of a range."""
    try:
        first, last = float(span["first"]), float(span["last"])
    except ValueError:
        raise InputError(Fault(COMMAND, "--sweep", "a range runs between two numbers", text)) from None
    count = int(span["count"])
    if not 2 <= count <= MAX_VALUES:
        raise InputError(Fault(COMMAND, "--sweep", f"a range must have 2 to {MAX_VALUES} values", text))
    if span["log"] and (first <= 0 or last <= 0):
        raise InputError(Fault(COMMAND, "--sweep", "a geometric range needs numbers above 0", text))
    return spanned(first, last, count, bool(span["log"]))


def spanned(first: float, last: float, count: int, log: bool) -> list[str]:
    """Return ``count`` evenly spaced values, or with ``log`` values of equal ratios, as text."""
    values = np.geomspace(first, last, count) if log else np.linspace(first, last, count)
    return [number_text(float(f"{value:.9g}")) for value in values]


def number_text(value: float) -> str:
    """Return a number without an exponent, which YAML would take for text."""
    return str(np.format_float_positional(value, trim="-"))


def grid_faults(sweeps: tuple[Sweep, ...], zipped: bool) -> list[Fault]:
    """Return what is wrong with a combination of axes."""
    paths = [sweep.path for sweep in sweeps]
    faults = [Fault(COMMAND, "--sweep", "must name each field once", path) for path in paths if paths.count(path) > 1]
    faults += [Fault(COMMAND, "--sweep", _NOT_SWEPT[path], path) for path in paths if path in _NOT_SWEPT]
    lengths = [len(sweep.values) for sweep in sweeps]
    if zipped and len(set(lengths)) > 1:
        faults.append(Fault(COMMAND, "--zip", "needs sweeps with equally many values", lengths))
    n_points = 1 if zipped else prod(lengths)
    if n_points > MAX_POINTS:
        rule = f"at most {MAX_POINTS:,} combinations of settings can be compared at once"
        faults.append(Fault(COMMAND, "--sweep", rule, f"{n_points:,}"))
    return list({str(fault): fault for fault in faults}.values())


def points_of(sweeps: tuple[Sweep, ...], zipped: bool) -> tuple[Point, ...]:
    """Return all points, the last axis fastest, or the axes' values side by side where ``zipped``."""
    if not sweeps:
        return (Point(None, {}),)
    paths = [sweep.path for sweep in sweeps]
    each = zip(*(sweep.values for sweep in sweeps), strict=True) if zipped else product(*(s.values for s in sweeps))
    return tuple(Point(", ".join(values), dict(zip(paths, values, strict=True))) for values in each)
