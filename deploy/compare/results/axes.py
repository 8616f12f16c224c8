"""Axes of a comparison whose values are numbers: these can be drawn to scale and stored as numbers."""

from collections.abc import Iterable
from math import isfinite
from typing import Any


def numbers_of(values: Iterable[str]) -> list[float] | None:
    """Return the values of an axis as numbers; None where one of them is not a finite number."""
    try:
        numbers = [float(value) for value in values]
    except ValueError:
        return None
    return numbers if all(map(isfinite, numbers)) else None


def numeric_axes(report: dict[str, Any]) -> list[str]:
    """Return the axes of a report that have at least two values, all of which are numbers."""
    found = []
    for path in report["axes"]:
        values = {about["at"][path] for about in report["settings"] if about["n_cells"]}
        if len(values) > 1 and numbers_of(values) is not None:
            found.append(path)
    return found
