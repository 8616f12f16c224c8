"""A study of admissible networks: border, checks on fresh seeds, profiles; its report as JSON values."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import ceil, isfinite, log2
from typing import Any, Final, NamedTuple

from tis.common.streams import Stream
from tis.deploy.compare.plan import Request
from tis.deploy.compare.results.pooled import ENOUGH_PEOPLE
from tis.deploy.shell.progress import length_text
from tis.deploy.studies.admissible.border import BISECTED, Border, Margins, find_border
from tis.deploy.studies.admissible.criterion import Limit
from tis.deploy.studies.admissible.evaluation import Evaluation, Judged, Network
from tis.deploy.studies.admissible.profiles import PlacedProfile, Redundancy, place_of, place_profiles
from tis.deploy.studies.admissible.region import Axis, Place, Region

# Independent check of a region: places drawn inside and outside of it, judged on fresh seeds.

_MOST_DRAWN: Final = 20_000
_SEED: Final = 1
MAX_OPTIMISTIC: Final = 0.1
MAX_OVERLOOKED: Final = 0.25


class Drawn(NamedTuple):
    """Places inside and outside of a region; fewer than requested where the region or its complement is small."""

    inside: list[Place]
    outside: list[Place]


class Check(NamedTuple):
    """Counts of drawn places, and of those whose verdict on fresh seeds disagrees with the region.

    ``optimistic``: outside, though the region holds them; ``overlooked``: inside, though it does not.
    """

    n_inside: int
    optimistic: int
    n_outside: int
    overlooked: int

    @property
    def text(self) -> str:
        """Warning if too many disagree; empty otherwise."""
        grid = "see a grid of the box by tis compare with --sweep ranges"
        if self.optimistic > MAX_OPTIMISTIC * self.n_inside:
            found = f"{self.optimistic} of {self.n_inside} places inside are not admissible on fresh seeds"
            return f"{found}: take more --seeds, or {grid}"
        if self.overlooked > MAX_OVERLOOKED * self.n_outside:
            found = f"{self.overlooked} of {self.n_outside} places outside are admissible"
            return f"{found}: take more --seeds, or the region has parts that no straight line reaches: {grid}"
        return ""


def drawn(region: Region, n_places: int, n_axes: int) -> Drawn:
    """Return up to half of ``n_places`` inside and half outside, drawn uniformly; always the same for a region."""
    uniforms = Stream.named(_SEED, "admissible/checks").uniforms(0, _MOST_DRAWN * n_axes)
    found = Drawn([], [])
    for i in range(_MOST_DRAWN):
        place = tuple(uniforms[i * n_axes : (i + 1) * n_axes].tolist())
        half = found.inside if region.contains(place) else found.outside
        if len(half) < (n_places + 1) // 2:
            half.append(place)
        elif len(found.inside) + len(found.outside) >= 2 * ((n_places + 1) // 2):
            break
    return found


_SEARCH: Final = "border"
_CHECK: Final = "check"
_STAGES: Final = "parts (border, checks, profiles)"
_N_STAGES: Final = 3


class Effort(NamedTuple):
    """Tolerance of the border as a share of an axis, most places of an estimator's search, and places of a check."""

    tolerance: float = 0.02
    max_points: int = 150
    n_checks: int = 20


def most_networks(n_axes: int, n_estimators: int, effort: Effort) -> int:
    """Return how many networks the borders and their checks take at most.

    On a single axis each third step halves the bracket. Oracle: the networks of searches, test_checks.
    """
    steps = BISECTED * ceil(log2(2.0 / effort.tolerance)) if n_axes == 1 else effort.max_points
    return (1 << n_axes + 1) + n_estimators * (min(steps, effort.max_points) + effort.n_checks)


class Order(NamedTuple):
    """What the options of a call determine: a scenario's name, what varies, limits, effort and profiles."""

    name: str
    request: Request
    axes: tuple[Axis, ...]
    limits: tuple[Limit, ...]
    estimators: tuple[str, ...]
    effort: Effort
    fresh_seed: int
    profiles: list[str]
    candidates: list[Redundancy]


@dataclass
class Study:
    """An order, and its networks as they are judged."""

    order: Order
    evaluation: Evaluation
    points: list[dict[str, Any]] = field(default_factory=list)

    def run(self, command: str) -> dict[str, Any]:
        """Return the report. Raises `InputError` and `DataError`."""
        order, names = self.order, self.order.estimators
        stages = self.evaluation.progress
        stages.total(_STAGES, _N_STAGES)
        self.evaluation.check_names(order.request, self._network((0.0,) * len(order.axes)))
        effort = order.effort
        border = find_border(
            self._margins, len(order.axes), len(names), effort.tolerance, effort.max_points * len(names)
        )
        stages.advance(_STAGES)
        checks = self._checks(border)
        stages.advance(_STAGES)
        placed = place_profiles(self.evaluation, order.request, order.profiles, order.candidates)
        return {
            "scenario": order.name,
            "command": command,
            "limits": [limit._asdict() for limit in order.limits],
            "axes": [vars(axis) for axis in order.axes],
            "persons": list(self.evaluation.persons),
            "synthetic": list(self.evaluation.synthetic),
            "n_seeds": order.request.n_seeds,
            "trained_on": self.evaluation.trained_on,
            **effort._asdict(),
            "estimators": {name: self._of_estimator(i, border, checks[name]) for i, name in enumerate(names)},
            "points": self.points,
            "profiles": [self._of_profile(one) for one in placed],
            "profiles_tried": [one._asdict() for one in order.candidates] if order.profiles else [],
            "n_points": self.evaluation.n_networks,
            "n_twins": self.evaluation.n_twins,
            "warnings": self._warnings(border, checks),
        }

    def so_far(self) -> str:
        """Return how many networks of the search are decided, and what is known of each border."""
        n_decided = sum(one["kind"] == _SEARCH for one in self.points)
        known = "; ".join(f"{name} {self._known(name)}" for name in self.order.estimators)
        return f"{n_decided} networks decided: {known}"

    def _left(self) -> str:
        """Return how long all takes at most, by what a network took so far; "" where some came from a file."""
        n, order = self.evaluation.n_networks, self.order
        if not n or self.evaluation.n_resumed:
            return ""
        most = most_networks(len(order.axes), len(order.estimators), order.effort)
        most += len(order.profiles) * max(1, len(order.candidates))
        left_s = self.evaluation.progress.passed_s / n * max(most - n, 0)
        return f"; at most about {length_text(left_s)} left in all"

    def _known(self, name: str) -> str:
        """Return the bracket of an estimator's border on a single axis; on several the number of places inside."""
        searched = self._searched(name)
        if len(self.order.axes) > 1:
            return f"admissible at {sum(found['inside'] for _, found in searched)}"
        path = self.order.axes[0].path
        inside_at = sorted((at[path], found["inside"]) for at, found in searched)
        way = "up to"
        if not inside_at[0][1]:
            inside_at.reverse()
            way = "down to"
        n_inside = next((i for i, (_, inside) in enumerate(inside_at) if not inside), len(inside_at))
        if not n_inside:
            return f"admissible at neither end of {path}"
        beyond = f", no longer at {inside_at[n_inside][0]:g}" if n_inside < len(inside_at) else ""
        return f"admissible {way} {path} = {inside_at[n_inside - 1][0]:g}{beyond}"

    def _network(self, place: Place) -> Network:
        return {axis.path: axis.text(share) for axis, share in zip(self.order.axes, place, strict=True)}

    def _values(self, place: Place) -> dict[str, float]:
        return {axis.path: axis.value(share) for axis, share in zip(self.order.axes, place, strict=True)}

    def _margins(self, places: Sequence[Place]) -> list[Margins]:
        """Judge places for the border's search."""
        judged = self._judged(self.order.request, places, _SEARCH)
        self.evaluation.progress.tell(self.so_far() + self._left())
        return [list(one.margins.values()) for one in judged]

    def _judged(self, request: Request, places: Sequence[Place], kind: str) -> list[Judged]:
        judged = self.evaluation.judge(request, [self._network(place) for place in places])
        for place, one in zip(places, judged, strict=True):
            self.points.append({"kind": kind, "at": self._values(place), **_verdicts(one)})
        return judged

    def _checks(self, border: Border) -> dict[str, Check]:
        """Judge places inside and outside of each region on fresh seeds, those of all estimators in one plan."""
        n_axes, names = len(self.order.axes), self.order.estimators
        places = {
            name: drawn(region, self.order.effort.n_checks, n_axes)
            for name, region in zip(names, border.regions, strict=True)
        }
        every = list(dict.fromkeys(place for both in places.values() for half in both for place in half))
        fresh = replace(self.order.request, seed=self.order.fresh_seed)
        judged = dict(zip(every, self._judged(fresh, every, _CHECK) if every else [], strict=True))
        return {name: _check(places[name], judged, name) for name in names}

    def _of_estimator(self, which: int, border: Border, check: Check) -> dict[str, Any]:
        region = border.regions[which]
        return {
            "share": region.share,
            "start": self._values(region.start),
            "border": [self._values(place) for place in region.border],
            "outline": [self._values(place) for place in _outline(region)],
            "alone": self._alone(region),
            "beyond": self._beyond(region, self.order.estimators[which]),
            "at_border": self._at_border(region, self.order.estimators[which]),
            "n_rays": border.n_rays[which],
            "n_open": border.n_open[which],
            "check": check._asdict(),
        }

    def _alone(self, region: Region) -> dict[str, float | None]:
        """Return how far each axis may go while the others are at their best; None for an empty region."""
        found: dict[str, float | None] = {}
        for i, axis in enumerate(self.order.axes):
            direction = tuple(float(i == j) for j in range(len(self.order.axes)))
            radii = [v.radius for simplex in region.simplices for v in simplex if v.direction == direction]
            share = radii[0] if radii else None
            start = region.start[i]
            found[axis.path] = None if share is None else axis.value(share if start == 0.0 else 1.0 - share)
        return found

    def _beyond(self, region: Region, name: str) -> dict[str, float | None]:
        """Return the nearest value outside on each axis, the others at their best; None if none is known."""
        start = self._values(region.start)
        outside = [at for at, found in self._searched(name) if not found["inside"]]
        found: dict[str, float | None] = {}
        for i, (path, best) in enumerate(start.items()):
            there = [at[path] for at in outside if all(at[one] == start[one] for one in start if one != path)]
            away = [value for value in there if value != best]
            found[path] = (min if region.start[i] == 0.0 else max)(away, default=None)
        return found

    def _at_border(self, region: Region, name: str) -> list[dict[str, list[float]]]:
        """Return the least and the largest figure and bound at the border, by limit; none for an empty region."""
        places = [self._values(place) for place in region.border]
        there = [found for at, found in self._searched(name) if at in places and found["inside"]]
        return [
            {what: [choose(one[what][i] for one in there) for choose in (min, max)] for what in ("figures", "bounds")}
            for i in range(len(self.order.limits) if there else 0)
        ]

    def _searched(self, name: str) -> list[tuple[dict[str, float], dict[str, Any]]]:
        return [(one["at"], one["verdicts"][name]) for one in self.points if one["kind"] == _SEARCH]

    def _of_profile(self, one: PlacedProfile) -> dict[str, Any]:
        helped = {
            name: None
            if help_ is None
            else {
                **help_[0]._asdict(),
                "text": help_[0].text,
                "packets_per_s": help_[1].packets_per_s,
                "bytes_per_s": help_[1].bytes_per_s,
            }
            for name, help_ in one.helped_by.items()
        }
        forward = {
            name: value if value is None or isfinite(value) else None for name, value in one.forward._asdict().items()
        }
        sent = {"packets_per_s": one.judged.packets_per_s, "bytes_per_s": one.judged.bytes_per_s}
        about = {
            "name": one.name,
            "title": one.title,
            "forward": forward,
            "at": place_of(one.forward, self.order.axes),
        }
        return {**about, **_verdicts(one.judged), **sent, "redundancy": helped}

    def _warnings(self, border: Border, checks: dict[str, Check]) -> list[str]:
        n_people = len(self.evaluation.persons)
        found = [few_text(n_people)] if n_people < ENOUGH_PEOPLE else []
        found += [f"{name}: {check.text}" for name, check in checks.items() if check.text]
        for i, (name, region) in enumerate(zip(checks, border.regions, strict=True)):
            if border.n_open[i]:
                rule = "so its region may be too small: more --points, or a larger --tolerance"
                found.append(f"{name}: the search ended before {border.n_open[i]} border points were known, {rule}")
            inside = [corner for corner, margins in border.corners.items() if margins[i] <= 0]
            if inside and not region.simplices:
                at = ", ".join(f"{path}={value}" for path, value in self._network(inside[0]).items())
                found.append(f"{name}: admissible at {at}, though not at the best corner of the others: run it alone")
        refused = dict.fromkeys(point["fault"] for point in self.points if point["fault"] is not None)
        if refused:
            found.append(f"a part of the box counts as outside, as the scenario refuses it: {next(iter(refused))}")
        unscored = list(self.evaluation.unscored)
        found += [f"a network without a scored tick counts as outside; {unscored[0]}"] if unscored else []
        return [*found, *self.evaluation.warnings]


def _outline(region: Region) -> list[Place]:
    """Return the region as a polygon, the best corner last; empty unless it lies in a plane."""
    return [*region.border, region.start] if len(region.start) == 2 and region.simplices else []


def few_text(n_people: int) -> str:
    """Return what so few people mean for the confidence."""
    return (
        f"{n_people} people are few: 95 % hold only if such people's figures are normally distributed; a claim about "
        f"others takes {ENOUGH_PEOPLE} people, as in tis compare"
    )


def _verdicts(judged: Judged) -> dict[str, Any]:
    """Return a network's verdict, figures and bounds by estimator, and why the scenario refuses it."""
    return {
        "fault": judged.fault,
        "verdicts": {
            name: {
                "inside": margin <= 0,
                "margin": margin if isfinite(margin) else None,
                **{
                    what: [value if isfinite(value) else None for value in found[name]]
                    for what, found in (("figures", judged.figures), ("bounds", judged.bounds))
                },
            }
            for name, margin in judged.margins.items()
        },
    }


def _check(places: Drawn, judged: dict[Place, Judged], name: str) -> Check:
    return Check(
        len(places.inside),
        sum(judged[place].margins[name] > 0 for place in places.inside),
        len(places.outside),
        sum(judged[place].margins[name] <= 0 for place in places.outside),
    )
