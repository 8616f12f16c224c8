"""Sums of a comparison for its page: of each point of the grid, person and hand, from which a browser pools."""

import base64
import gzip
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tis.common.streams import Stream
from tis.common.units import NS_PER_MS
from tis.deploy.compare.cells.sums import AGE_EDGES_MS
from tis.deploy.compare.engine.compute import Outcome
from tis.deploy.compare.grid import axis_words
from tis.deploy.compare.plan import Plan
from tis.deploy.compare.results.pooled import N_RESAMPLES, SEED, person
from tis.deploy.compare.results.report import numbers_of
from tis.patient_side.linear_system import Array

Places = NDArray[np.int32]

_MAX_DRAWS: Final = 200_000
"""Draws of the bootstrap in a page: `N_RESAMPLES` of up to 100 people, fewer resamples of more."""
_N_BINS: Final = len(AGE_EDGES_MS)


@dataclass(frozen=True)
class PageSums:
    """Sums of G groups, each of one point, person and hand, for E estimators; B bins of age.

    ``points`` has the place of each point's value on each axis. Where an estimator is not in a group, its ``sse``
    is NaN.
    """

    axes: Mapping[str, Sequence[str]]
    people: Sequence[str]
    hands: Sequence[str]
    estimators: Sequence[str]
    points: Sequence[Sequence[int]]
    group: Places
    """(G, 3): point, person, hand."""
    n: Array
    """(G,) scored ticks."""
    sst: Array
    """(G, 3) in m^2."""
    n_by_age: Array
    """(G, B)."""
    age_by_age: Array
    """(G, B) sums of ages in ms."""
    sse: Array
    """(G, E, 3) in m^2."""
    counts: Array
    """(G, E, 3): missing estimates, errors within the ellipsoid, ellipsoids."""
    sse_by_age: Array
    """(G, E, B) in m^2."""

    def about(self) -> dict[str, Any]:
        """Return what is no array, as JSON values."""
        return {
            "axes": [
                {"path": path, "title": axis_words(path), "values": values, "numbers": numbers_of(values)}
                for path, values in self.axes.items()
            ],
            "people": self.people,
            "hands": self.hands,
            "estimators": self.estimators,
            "points": self.points,
            "n_groups": len(self.group),
            "age_edges_ms": AGE_EDGES_MS,
            "n_resamples": N_RESAMPLES,
        }

    def packed(self) -> str:
        """Return the arrays and the draws of the bootstrap, little-endian, one after the other: gzip in base64."""
        draws = Stream.named(SEED, "compare/bootstrap").uniforms(0, min(N_RESAMPLES * len(self.people), _MAX_DRAWS))
        floats = (self.n, self.sst, self.n_by_age, self.age_by_age, self.sse, self.counts)
        parts = [array.astype("<f8").tobytes() for array in floats]
        # The largest part is only drawn: single precision will do.
        parts += [
            self.sse_by_age.astype("<f4").tobytes(),
            self.group.astype("<i4").tobytes(),
            (draws * 2.0**32).astype("<u4").tobytes(),
        ]
        return base64.b64encode(gzip.compress(b"".join(parts), 6, mtime=0)).decode()


def page_sums(plan: Plan, outcome: Outcome) -> PageSums:
    """Return the sums of all computed cells; those of a person's trials and seeds are added up."""
    axes = {path: list(dict.fromkeys(point.values[path] for point in plan.points)) for path in plan.axes}
    place = {path: {value: i for i, value in enumerate(values)} for path, values in axes.items()}
    which = {point.label: i for i, point in enumerate(plan.points)}
    # entries of each group, in the order of the plan
    people: dict[str, int] = {}
    hands: dict[str, int] = {}
    groups: dict[tuple[int, int, int], list[Mapping[str, Any]]] = {}
    for cell in plan.cells:
        result = outcome.cells.get(cell.digest)
        for hand, entry in {} if result is None else result["hands"].items():
            i, j = people.setdefault(person(cell), len(people)), hands.setdefault(hand, len(hands))
            groups.setdefault((which[cell.setting], i, j), []).append(entry)
    each = [_added(entries, plan.estimators) for entries in groups.values()]
    shapes: list[tuple[int, ...]] = [(), (3,), (_N_BINS,), (_N_BINS,)]
    shapes += [(len(plan.estimators), size) for size in (3, 3, _N_BINS)]
    columns = list(zip(*each, strict=True)) or [()] * len(shapes)
    arrays = [np.array(part).reshape(len(each), *shape) for part, shape in zip(columns, shapes, strict=True)]
    return PageSums(
        axes,
        list(people),
        list(hands),
        list(plan.estimators),
        [[place[path][point.values[path]] for path in axes] for point in plan.points],
        np.array(list(groups), dtype=np.int32).reshape(-1, 3),
        *arrays,
    )


def _added(entries: Sequence[Mapping[str, Any]], names: Sequence[str]) -> list[Any]:
    """Return the arrays of one group."""
    keys = ("n_scored", "sst_m2", "n_by_age", "age_sum_by_age_ns")
    of_hand = [np.sum([entry[key] for entry in entries], axis=0) for key in keys]
    of_hand[-1] = of_hand[-1] / NS_PER_MS
    sse, counts, by_age = [], [], []
    for name in names:
        found = [entry["estimators"].get(name) for entry in entries]
        known = [one for one in found if one is not None]
        if len(known) < len(found):  # it would be pooled over other ticks than the others
            sse.append([np.nan] * 3)
            counts.append([0] * 3)
            by_age.append([0.0] * _N_BINS)
            continue
        sse.append(np.sum([one["sse_m2"] for one in known], axis=0))
        counted = ("n_missing", "n_covered", "n_ellipsoids")
        counts.append([sum(one.get(key, 0) for one in known) for key in counted])
        by_age.append(np.sum([one["sse_by_age_m2"] for one in known], axis=0))
    return [*of_hand, sse, counts, by_age]
