"""Limits on figures: ``NAME<=V``, ``NAME>=V``, or ``NAME=V`` in the figure's natural direction."""

import re
from math import isfinite, log
from typing import Final, NamedTuple

from tis.common.errors import Fault, InputError

COMMAND: Final = "tis admissible"
_LIMIT: Final = re.compile(r"(?P<name>[A-Za-z][^<>=\s]*)\s*(?P<relation><=|>=|=)\s*(?P<value>\S+)")
_RMSE: Final = re.compile(r"(?<![a-z])rmse")  # and not nrmse_fit, which may be negative
_LARGER_IS_BETTER: Final = ("coverage", "r2_", "nrmse_fit", "valid", "faithful", "consistent")
_LARGEST_MARGIN: Final = 20.0


class Limit(NamedTuple):
    """Largest value of a figure, or its smallest one unless ``at_most``."""

    name: str
    at_most: bool
    value: float

    @property
    def is_root_mean_square(self) -> bool:
        """True for a figure that is pooled over twins and persons by its square."""
        return _RMSE.search(self.name) is not None

    @property
    def text(self) -> str:
        """The limit as the command line takes it."""
        return f"{self.name}{'<=' if self.at_most else '>='}{self.value:g}"

    def margin(self, bound: float) -> float:
        """Return how far a bound is beyond the limit: 0 at it, negative within it, infinite if unknown.

        ``log(bound / limit)`` where both are positive, else the difference over the limit, or over 1 below 1.
        """
        if not isfinite(bound):
            return float("inf")
        if self.value > 0 and bound > 0:
            beyond = log(bound / self.value)
        else:
            beyond = (bound - self.value) / max(1.0, abs(self.value))
        beyond = beyond if self.at_most else -beyond
        return min(_LARGEST_MARGIN, max(-_LARGEST_MARGIN, beyond))


def parse_limit(text: str) -> Limit:
    """Return a limit; raises `InputError`."""
    found = _LIMIT.fullmatch(text.strip())
    if found is None:
        raise InputError(Fault(COMMAND, "--limit", "must read NAME=VALUE, NAME<=VALUE or NAME>=VALUE", text))
    try:
        value = float(found["value"])
    except ValueError:
        value = float("nan")
    if not isfinite(value):
        raise InputError(Fault(COMMAND, "--limit", "must be a number", text))
    at_most = found["relation"] == "<="
    if found["relation"] == "=":
        at_most = not any(word in found["name"] for word in _LARGER_IS_BETTER)
    return Limit(found["name"], at_most, value)
