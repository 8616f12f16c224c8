"""Scores pooled over people, with bootstrap intervals over people.

All scores are functions of sums over ticks, arms, seeds, trials and people, so that every tick has the same weight.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.runtime.recordings import person_of
from tis.common.scenario.source import RecordedSource
from tis.common.streams import Stream
from tis.common.units import MM_PER_M
from tis.deploy.compare.cells.cell import Cell
from tis.patient_side.linear_system import Array

# People of a comparison: the units over which intervals are resampled, as their trials are not independent.


def person(cell: Cell) -> str:
    """Return who moves in a recorded trial; each seed of a synthetic source is a person of its own."""
    source = cell.scenario.source
    return person_of(source, cell.trial) if isinstance(source, RecordedSource) else cell.trial


def fewest(rows: Iterable[Mapping[str, Any]]) -> int:
    """Return the number of people of the row that has the fewest; `ENOUGH_PEOPLE` without rows."""
    return min((int(row["n_people"]) for row in rows), default=ENOUGH_PEOPLE)


def interval_note(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return a note on intervals over few people; empty from `ENOUGH_PEOPLE` on."""
    n_people = fewest(rows)
    if n_people >= ENOUGH_PEOPLE:
        return ""
    if n_people < 2:
        return "There is no interval, since intervals are over people or devices and this is a single one."
    return (
        f"The 95 % intervals rest on {n_people} people only. They cannot be wider than the range of these people's "
        "own figures, which holds the median of all people with a probability of "
        f"{range_holds_median_pct(n_people):.0f} %; it takes {ENOUGH_PEOPLE} people for more than 95 %."
    )


def origin(report: Mapping[str, Any]) -> str:
    """Return whether a comparison's movement is synthetic, partly so, or recorded ("")."""
    n = len(report.get("synthetic", ()))
    return "" if not n else "synthetic" if n == len(report["trials"]) else "partly synthetic"


def band_words(report: Mapping[str, Any]) -> str:
    """Return what the bands of a report's figures are, with the number of people and what so few of them mean."""
    n_people, made = fewest(report["rows"]), f"{origin(report)} movement. ".capitalize() * bool(origin(report))
    if n_people < 2:
        return f"{made}No bands: intervals are over people or devices, and this is a single one."
    who = f"{n_people} people{', one for each seed' * (report['source'] == 'synthetic')}"
    few = f". So few cover less than 95 %: at most {range_holds_median_pct(n_people):.0f} %"
    return f"{made}Bands: 95 % bootstrap intervals over {who}{few * (n_people < ENOUGH_PEOPLE)}."


N_RESAMPLES: Final = 2000
SEED: Final = 1
_TAILS: Final = (2.5, 97.5)

ENOUGH_PEOPLE: Final = 6
"""Number of people whose range holds the median of all with more than 95 % (`range_holds_median_pct`)."""


class Sums(NamedTuple):
    """Sums of one estimator; the last axis is x, y, z for sums per axis, with any leading axes.

    ``nsse`` is in units of the training part's range; ``n_ranged`` counts the ticks of axes with a range.
    """

    n: Array
    sse: Array
    sst: Array
    nsse: Array
    n_ranged: Array
    hold_sse: Array
    n_missing: Array
    n_covered: Array
    n_ellipsoids: Array


def sums_of(hands: Sequence[Mapping[str, Any]], estimator: str) -> Sums:
    """Return an estimator's sums over several hands' entries (see `tis.deploy.compare.cells.sums.hand_sums`)."""
    rows = []
    for hand in hands:
        entry, hold = hand["estimators"][estimator], hand["estimators"]["hold"]
        sse, ranges = np.array(entry["sse_m2"]), np.array(hand["range_m"])
        ranged = ranges > 0
        rows.append(
            Sums(
                n=np.array(hand["n_scored"], dtype=float),
                sse=sse,
                sst=np.array(hand["sst_m2"]),
                nsse=np.where(ranged, sse / np.where(ranged, ranges, 1.0) ** 2, 0.0),
                n_ranged=np.where(ranged, float(hand["n_scored"]), 0.0),
                hold_sse=np.array(hold["sse_m2"]),
                n_missing=np.array(entry["n_missing"], dtype=float),
                n_covered=np.array(entry.get("n_covered", 0), dtype=float),
                n_ellipsoids=np.array(entry.get("n_ellipsoids", 0), dtype=float),
            )
        )
    return Sums(*(np.sum(column, axis=0) for column in zip(*rows, strict=True)))


class Scores(NamedTuple):
    """Reported scores, for any leading axes; NaN where undefined."""

    r2_pct: Array
    rmse_mm: Array
    rmse_3d_mm: Array
    rmse_normalized: Array
    ratio_to_hold: Array
    coverage_pct: Array


def scores_of(sums: Sums) -> Scores:
    """Return the scores of sums: ``100 (1 - SSE / SST)``, roots of mean squares, the share within the ellipsoid."""
    with np.errstate(divide="ignore", invalid="ignore"):
        total, hold = sums.sse.sum(axis=-1), sums.hold_sse.sum(axis=-1)
        return Scores(
            r2_pct=np.where(sums.sst > 0, 100 * (1 - sums.sse / sums.sst), np.nan),
            rmse_mm=MM_PER_M * np.sqrt(sums.sse / sums.n[..., None]),
            rmse_3d_mm=MM_PER_M * np.sqrt(total / sums.n),
            rmse_normalized=np.sqrt(sums.nsse / sums.n_ranged),
            ratio_to_hold=np.where(hold > 0, np.sqrt(total / hold), np.nan),
            coverage_pct=100 * sums.n_covered / sums.n_ellipsoids,
        )


def pooled(units: Sequence[Sequence[Mapping[str, Any]]], estimator: str) -> dict[str, Any]:
    """Return an estimator's pooled scores and their 95 % intervals; ``units`` holds each person's hands.

    The intervals are percentiles of 2000 resamples of people, with replacement (Efron, "Bootstrap methods: another
    look at the jackknife", 1979): None for a single one. A person is resampled with all
    trials and seeds, since these are not independent. All estimators share the resamples, so a ratio to hold
    compares the same people. Oracle: `tis.common.metrics.tracking.score` of the arrays, and a loop over resamples.
    """
    # sums per person, stacked: pooling and resampling are sums over the first axis
    each = [sums_of(hands, estimator) for hands in units]
    stacked = Sums(*(np.stack(column) for column in zip(*each, strict=True)))
    total = Sums(*(column.sum(axis=0) for column in stacked))
    result: dict[str, Any] = {name: _plain(value) for name, value in scores_of(total)._asdict().items()}
    result |= {"n_scored": int(total.n), "n_missing": int(total.n_missing), "n_people": len(units)}
    intervals: dict[str, Any] = dict.fromkeys(Scores._fields)
    if len(units) > 1:
        chosen = resampled(len(units))
        again = scores_of(Sums(*(column[chosen].sum(axis=1) for column in stacked)))
        intervals = {name: interval(value) for name, value in again._asdict().items()}
    return result | {f"{name}_interval_95": value for name, value in intervals.items()}


def rivalries(units: Sequence[Sequence[Mapping[str, Any]]], names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return each estimator's 3D RMSE over the smallest one, and its 95 % interval over the same resamples.

    The interval is None for a single person. As both are resampled together, it is of the same people: narrower than
    two intervals side by side (Efron and Tibshirani, "An Introduction to the Bootstrap", 1993, 8.3). Oracle: a loop
    over resamples, test_pooled.
    """
    # squared errors by estimator and person (E, P); each estimator has the same ticks
    squares = np.array([[sums_of(hands, name).sse.sum() for hands in units] for name in names])
    whole = squares.sum(axis=1)
    best = int(np.argmin(np.where(np.isfinite(whole), whole, np.inf)))  # a filter may have diverged
    chosen = resampled(len(units)) if len(units) > 1 else None
    found = {}
    with np.errstate(divide="ignore", invalid="ignore"):
        for name, own in zip(names, squares, strict=True):
            bounds = None
            if chosen is not None:
                bounds = interval(np.sqrt(own[chosen].sum(axis=1) / squares[best][chosen].sum(axis=1)))
            ratio = _plain(np.sqrt(own.sum() / whole[best]))
            found[name] = {"ratio_to_best": ratio, "ratio_to_best_interval_95": bounds}
    return found


def range_holds_median_pct(n_people: int) -> float:
    """Return the probability, in per cent, that the range of independent people holds the median of all people.

    ``100 (1 - 2**(1 - n))``: it fails if all are above or all below (David and Nagaraja, "Order Statistics", 2003,
    7.1). A bootstrap interval over people of a ratio or an error lies within that range at any level, so this bounds
    the coverage of an interval of few people. Oracle: drawn people, test_pooled.
    """
    return 100 * (1 - 2.0 ** (1 - n_people))


def resampled(n_units: int) -> NDArray[np.int64]:
    """Return the units of each resample, (2000, n), identical for all comparisons."""
    uniforms = Stream.named(SEED, "compare/bootstrap").uniforms(0, N_RESAMPLES * n_units)
    return (uniforms * n_units).astype(np.int64).reshape(N_RESAMPLES, n_units)


def interval(values: Array) -> Any:
    """Return low and high of a score's resamples (2000,), or those of each axis (2000, 3)."""
    if values.ndim == 2:
        return [interval(values[:, axis]) for axis in range(values.shape[1])]
    if not np.isfinite(values).all():
        return None
    return [float(bound) for bound in np.percentile(values, _TAILS)]


def _plain(value: Array) -> Any:
    if value.ndim:
        return [_plain(part) for part in value]
    return float(value) if np.isfinite(value) else None
