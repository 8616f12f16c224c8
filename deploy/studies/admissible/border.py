"""Border of the region in which margins are at most 0, found by adaptive sampling along rays.

All rays of all estimators advance together, one batch of places a round. Where the straight border between two
neighbouring rays misses the crossing of the ray midway by more than the tolerance, it is divided there. Regions that
are not star-shaped about the best corner are found in part, never beyond the first crossing of a ray. Oracles: known
shapes and areas, test_border.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations, product
from math import isfinite
from typing import Final, NamedTuple

from tis.deploy.studies.admissible.region import Place, Region, Simplex, Vertex, along, whole_box

# Rays from the best corner of the unit box: the first crossing of each one, by a bracketing root finder.
#
# A direction has a largest component of 1, so a distance along it is the share of an axis. A margin at most 0 is
# inside. Of the distances known to be inside before the first one outside, the last is the ray's radius: an error of
# the search leaves the region too small, not too large.

Margins = Sequence[float]
"""Margins at a place, one for each estimator."""

BISECTED: Final = 3
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
        if step % BISECTED == 0 or not (isfinite(low) and isfinite(high)):
            return (inside + outside) / 2
        root = inside + (outside - inside) * -low / (high - low)
        root += least if root - inside < outside - root else -least
        return min(outside - least, max(inside + least, root))


Evaluate = Callable[[Sequence[Place]], Sequence[Margins]]
"""Returns the margins at places of the unit box, in their order."""

_ALWAYS_DIVIDED: Final = 0.5
"""Distance of two directions above which the border between them is divided, however straight it looks."""

_LARGEST_COUNTED: Final = 100.0


class Border(NamedTuple):
    """Region of each estimator; ``n_rays`` and ``n_open``: its rays, and those not known within the tolerance.

    ``corners`` are the margins at the corners of the box.
    """

    regions: tuple[Region, ...]
    n_rays: tuple[int, ...]
    n_open: tuple[int, ...]
    corners: dict[Place, Margins]


def find_border(
    evaluate: Evaluate, n_axes: int, n_estimators: int, tolerance: float = 0.02, max_points: int = 200
) -> Border:
    """Return the regions, from evaluations of at most ``max_points`` places besides the corners and halfway to them.

    Parameters
    ----------
    evaluate : Evaluate
        Margins at places; a NaN counts as outside.
    n_axes, n_estimators : int
        Number of axes, and of margins at each place.
    tolerance : float
        Error of the border, as a share of an axis.
    max_points : int
        Budget; without enough of it the regions stay smaller, and ``n_open`` counts the rays it was missing for.
    """
    corners = list(product((0.0, 1.0), repeat=n_axes))
    known = dict(zip(corners, map(_outside_if_unknown, evaluate(corners)), strict=True))
    start = _best_corner(known)
    rays: dict[Place, Ray] = {}
    searches = []
    for which in range(n_estimators):
        simplices = whole_box(n_axes) if known[start][which] <= 0 else []
        searches.append(_Search(which, tolerance, rays, simplices))
    for direction in {direction for search in searches for simplex in search.simplices for direction in simplex}:
        rays[direction] = Ray(direction, {0.0: known[start], 1.0: known[along(start, direction, 1.0)]})
    # The corners alone would not show a gap between them and the best one.
    halfway = [along(start, direction, 0.5) for direction in rays]
    for ray, margins in zip(rays.values(), evaluate(halfway) if rays else [], strict=True):
        ray.known[0.5] = _outside_if_unknown(margins)
    n_left = max_points
    while n_left > 0 and (wanted := _wanted(searches)):
        chosen = list(wanted)[:n_left]
        n_left -= len(chosen)
        found = evaluate([along(start, direction, distance) for direction, distance in chosen])
        for (direction, distance), margins in zip(chosen, found, strict=True):
            rays[direction].known[distance] = _outside_if_unknown(margins)
    for search in searches:
        search.divide()
    return Border(
        tuple(search.region(start) for search in searches),
        tuple(len(search.directions) for search in searches),
        tuple(search.n_open for search in searches),
        known,
    )


def _best_corner(known: Mapping[Place, Margins]) -> Place:
    """Return the corner that is inside for most estimators, then by its largest margin, then by its neighbours'.

    The first values of the axes win a tie.
    """

    def rank(corner: Place) -> tuple[int, float, float]:
        beside = [other for other in known if sum(a != b for a, b in zip(corner, other, strict=True)) == 1]
        around = sum(min(_LARGEST_COUNTED, max(known[other])) for other in beside)
        return sum(margin > 0 for margin in known[corner]), round(max(known[corner]), 6), around

    return min(known, key=rank)


def _outside_if_unknown(margins: Margins) -> Margins:
    return tuple(float("inf") if margin != margin else margin for margin in margins)


def _wanted(searches: Sequence["_Search"]) -> dict[tuple[Place, float], None]:
    """Return the places that the searches need next, each once, by direction and distance."""
    found: dict[tuple[Place, float], None] = {}
    for search in searches:
        found |= dict.fromkeys(search.wanted())
    return found


@dataclass(eq=False)
class _Search:
    """The border of one estimator: simplices of directions, and the edges that are to be divided at a middle ray."""

    which: int
    tolerance: float
    rays: dict[Place, Ray]
    simplices: list[Simplex]
    middles: dict[frozenset[Place], Vertex] = field(default_factory=dict)
    straight: set[frozenset[Place]] = field(default_factory=set)

    @property
    def directions(self) -> set[Place]:
        """The directions of all simplices."""
        return {direction for simplex in self.simplices for direction in simplex}

    @property
    def n_open(self) -> int:
        """Number of rays whose crossing is not known within the tolerance."""
        searched = [*self.directions, *(middle.direction for middle in self.middles.values())]
        return sum(not self.rays[direction].is_known(self.which, self.tolerance) for direction in searched)

    def region(self, start: Place) -> Region:
        """Return the region as it is known."""
        radii = {direction: self.rays[direction].radius(self.which) for direction in self.directions}
        return Region(
            start, tuple(tuple(Vertex(each, radii[each]) for each in simplex) for simplex in self.simplices)
        )

    def wanted(self) -> list[tuple[Place, float]]:
        """Return the places to evaluate next, by direction and distance; none when the border is known."""
        # A middle ray may be known already, from another estimator's search, and its halves have middles in turn.
        while self._begin_middles() and self.divide():
            pass
        searched = [*self.directions, *(middle.direction for middle in self.middles.values())]
        return [(one, t) for one in searched for t in self.rays[one].wanted(self.which, self.tolerance)]

    def _begin_middles(self) -> bool:
        """Begin the middle rays of edges whose ends are known; tell whether any middle ray is searched."""
        edges = {frozenset(edge) for simplex in self.simplices for edge in combinations(simplex, 2)}
        for edge in edges - self.straight - self.middles.keys():
            if not all(self.rays[end].is_known(self.which, self.tolerance) for end in edge):
                continue
            if (middle := self._middle(edge)) is None:
                self.straight.add(edge)
            else:
                self.middles[edge] = middle
        return bool(self.middles)

    def _middle(self, edge: frozenset[Place]) -> Vertex | None:
        """Return the middle ray of an edge and where a straight border would cross it, and begin to search it.

        None where the edge is short, or a step of the border.
        """
        one, other = edge
        ends = [self.rays[each].radius(self.which) for each in (one, other)]
        apart = max(abs(a * ends[0] - b * ends[1]) for a, b in zip(one, other, strict=True))
        turn = _turn(edge) * max(ends)
        if apart <= self.tolerance or turn <= self.tolerance / 2:
            return None
        # A wide edge is divided midway between its rays, as estimators then share the ray; others through the middle
        # of the straight border. The ends lie in one face of the box, so the middle has a component of 1, too.
        share = 0.5 if _is_wide(edge) else ends[0] / (ends[0] + ends[1])
        direction = tuple(share * a + (1.0 - share) * b for a, b in zip(one, other, strict=True))
        straight = 1.0 / (share / ends[0] + (1.0 - share) / ends[1]) if min(ends) > 0 else 0.0
        ray = self.rays.setdefault(direction, Ray(direction, {0.0: self.rays[one].known[0.0]}))
        ray.guesses[self.which] = straight
        return Vertex(direction, straight)

    def divide(self) -> bool:
        """Divide all simplices at the middle rays whose crossing is known; tell whether there was any."""
        n_searched = len(self.middles)
        for edge, middle in list(self.middles.items()):
            new, straight = middle
            ray = self.rays[new]
            if not ray.is_known(self.which, self.tolerance):
                continue
            del self.middles[edge]
            one, other = edge
            if not _is_wide(edge) and abs(ray.radius(self.which) - straight) <= self.tolerance:
                self.straight |= {frozenset((one, new)), frozenset((new, other))}
            parts: list[Simplex] = []
            for simplex in self.simplices:
                if one in simplex and other in simplex:
                    parts += [_replaced(simplex, one, new), _replaced(simplex, other, new)]
                else:
                    parts.append(simplex)
            self.simplices = parts
        return len(self.middles) < n_searched


def _replaced(simplex: Simplex, old: Place, new: Place) -> Simplex:
    return tuple(new if each == old else each for each in simplex)


def _turn(edge: frozenset[Place]) -> float:
    one, other = edge
    return max(abs(a - b) for a, b in zip(one, other, strict=True))


def _is_wide(edge: frozenset[Place]) -> bool:
    return _turn(edge) > _ALWAYS_DIVIDED
