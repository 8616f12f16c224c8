"""Axes of the region: a field of the scenario between two values, mapped to the unit interval."""

import re
from dataclasses import dataclass
from math import exp, isfinite, log
from typing import Final

import numpy as np

from tis.common.errors import Fault, InputError
from tis.deploy.admissible.limits import COMMAND
from tis.deploy.compare.grid import Sweep, grid_faults

MAX_AXES: Final = 4
_RANGE: Final = re.compile(r"(?P<first>[^:]+?)\.\.(?P<last>[^:]+?)(?P<log>:log)?")
_RULE: Final = "must read a.b=FIRST..LAST[:log], two numbers, the smaller one first"


@dataclass(frozen=True)
class Axis:
    """A field from ``first`` to ``last`` > ``first``; ``log``: by equal ratios; ``whole``: it takes integers only."""

    path: str
    first: float
    last: float
    log: bool = False
    whole: bool = False

    def value(self, share: float) -> float:
        """Return the field's value at a share of the axis in [0, 1]."""
        if share in (0.0, 1.0):
            return self.last if share else self.first
        if self.log:
            found = exp(log(self.first) + share * (log(self.last) - log(self.first)))
        else:
            found = self.first + share * (self.last - self.first)
        return float(round(found)) if self.whole else float(f"{found:.9g}")

    def share(self, value: float) -> float:
        """Return the share of the axis at a value, outside of [0, 1] beyond the ends."""
        if self.log:
            if value <= 0:
                return float("-inf")
            return (log(value) - log(self.first)) / (log(self.last) - log(self.first))
        return (value - self.first) / (self.last - self.first)

    def text(self, share: float) -> str:
        """Return the value as a setting takes it: without an exponent, which YAML would take for text."""
        value = self.value(share)
        return str(int(value)) if self.whole else np.format_float_positional(value, trim="-")


def parse_axis(text: str) -> Axis:
    """Return ``a.b=FIRST..LAST[:log]`` as an axis; raises `InputError`."""
    path, equals, span = text.partition("=")
    found = _RANGE.fullmatch(span.strip())
    if not equals or not all(path.split(".")) or found is None:
        raise InputError(Fault(COMMAND, "--over", _RULE, text))
    try:
        first, last = float(found["first"]), float(found["last"])
    except ValueError:
        raise InputError(Fault(COMMAND, "--over", _RULE, text)) from None
    if not (isfinite(first) and isfinite(last)) or first >= last:
        rule = "the range is empty or reversed" if first >= last else _RULE
        raise InputError(Fault(COMMAND, "--over", f"{rule}: the smaller number comes first", text))
    if found["log"] and first <= 0:
        raise InputError(Fault(COMMAND, "--over", "a geometric range needs numbers above 0", text))
    return Axis(path, first, last, log=found["log"] is not None)


def whole_fault(axis: Axis) -> Fault | None:
    """Return the fault of an axis of integers that ends between two of them."""
    if not axis.whole or (axis.first.is_integer() and axis.last.is_integer()):
        return None
    rule = "takes integers only, so the range must run between two of them"
    return Fault(COMMAND, "--over", rule, f"{axis.path}={axis.first:g}..{axis.last:g}")


def axis_faults(axes: tuple[Axis, ...]) -> list[Fault]:
    """Return what is wrong with a combination of axes."""
    if len(axes) > MAX_AXES:
        return [Fault(COMMAND, "--over", f"at most {MAX_AXES} fields can vary at once", len(axes))]
    if not axes:
        return [Fault(COMMAND, "--over", "is required: a.b=FIRST..LAST, the field that varies")]
    faults = grid_faults(tuple(Sweep(axis.path, ("",)) for axis in axes), zipped=True)
    return [Fault(COMMAND, "--over", fault.rule.replace("swept", "varied"), fault.got) for fault in faults]
