"""Rays from the best corner of the unit box: the first crossing of each one, by a bracketing root finder.

A direction has a largest component of 1, so a distance along it is the share of an axis. A margin at most 0 is
inside. Of the distances known to be inside before the first one outside, the last is the ray's radius: an error of
the search leaves the region too small, not too large.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import Final, NamedTuple

Place = tuple[float, ...]
"""Point of the unit box, a share of each axis."""

Margins = Sequence[float]
"""Margins at a place, one for each estimator."""

_BISECTED: Final = 3
"""Each third step halves the bracket, so that no margin, however bent, makes the search slow."""


class Bracket(NamedTuple):
    """Distances inside and outside between which a ray leaves the region; ``outside`` is None if it is unknown."""

    inside: float
    outside: float | None


@dataclass(eq=False)
class Ray:
    """A direction, the margins known along it by distance, and guesses of the crossing by estimator."""

    direction: Place
    known: dict[float, Margins] = field(default_factory=dict)
    guesses: dict[int, float] = field(default_factory=dict)
    steps: dict[int, int] = field(default_factory=dict)

    def bracket(self, which: int) -> Bracket:
        """Return the bracket of an estimator's first crossing; distance 0 is known to be inside."""
        inside = 0.0
        for distance in sorted(self.known):
            if self.known[distance][which] > 0:
                return Bracket(inside, distance)
            inside = distance
        return Bracket(inside, None)

    def radius(self, which: int) -> float:
        """Return the largest distance that is known to be inside up to the first one outside."""
        return self.bracket(which).inside

    def is_known(self, which: int, tolerance: float) -> bool:
        """Tell whether the crossing is known within half the tolerance, or that there is none in the box."""
        inside, outside = self.bracket(which)
        return inside >= 1.0 if outside is None else outside - inside <= tolerance / 2 + 1e-12

    def wanted(self, which: int, tolerance: float) -> list[float]:
        """Return the distances to evaluate next; none when the crossing is known."""
        if self.is_known(which, tolerance):
            return []
        inside, outside = self.bracket(which)
        guess = self.guesses.pop(which, None)
        if guess is not None:
            # Around the guess first: if it is right, these points are all it takes.
            around = [1.0] if guess >= 1.0 else [max(0.0, guess - tolerance / 4), min(1.0, guess + tolerance / 4)]
            if new := [distance for distance in around if distance not in self.known]:
                return new
        if outside is None:
            return [1.0] if inside >= 0.5 else [0.5, 1.0]
        return [self._between(which, inside, outside, tolerance / 4)]

    def _between(self, which: int, inside: float, outside: float, least: float) -> float:
        """Return a distance within the bracket: by the secant, pushed towards its longer part, or its middle."""
        step = self.steps[which] = self.steps.get(which, 0) + 1
        low = self.known[inside][which] if inside in self.known else float("-inf")
        high = self.known[outside][which]
        if step % _BISECTED == 0 or not (isfinite(low) and isfinite(high)):
            return (inside + outside) / 2
        root = inside + (outside - inside) * -low / (high - low)
        root += least if root - inside < outside - root else -least
        return min(outside - least, max(inside + least, root))
