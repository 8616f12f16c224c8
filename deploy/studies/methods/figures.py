"""Figures of one method, by measure, as plain JSON: the content of the table, its page and its files."""

from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any, Final, NamedTuple

import numpy as np

from tis.common.scenario.estimator_names import is_learned
from tis.deploy.compare.results.pooled import resampled, sums_of
from tis.deploy.studies.methods.computing import Computed
from tis.deploy.studies.methods.plans import ALL, HOLD, OTHER_PERSON, OWN, Measure, loss_text, losses_of
from tis.deploy.studies.methods.steps import Stepped

# Exponent of a cost: the slope of a straight line through its logarithms, with a confidence interval.


class PowerLaw(NamedTuple):
    """A cost that grows as ``size ** exponent``; ``low`` and ``high`` are the 95 % confidence interval.

    The interval is None where two sizes, or one, leave no residual to tell it from.
    """

    exponent: float
    low: float | None
    high: float | None
    n: int


def fit_power_law(sizes: Sequence[float], costs: Sequence[float]) -> PowerLaw | None:
    """Return the exponent of ``costs`` against ``sizes``, both (N,) and positive; None with fewer than two sizes.

    Least squares on the logarithms; the interval is Student's with N - 2 degrees of freedom (Draper and Smith,
    "Applied Regression Analysis", 1.4), for errors that are independent, of equal ratio and normal. A cost with a
    constant part has a smaller exponent than its growing part. Oracle: known exponents, and the interval's coverage
    over drawn errors, test_power_law.
    """
    from scipy.stats import t as student  # late: it takes long to load

    x, y = np.log(np.asarray(sizes, dtype=float)), np.log(np.asarray(costs, dtype=float))
    spread = float(np.sum((x - x.mean()) ** 2)) if len(x) else 0.0
    if spread == 0.0:
        return None
    exponent = float(np.sum((x - x.mean()) * (y - y.mean())) / spread)
    freedom = len(x) - 2
    if freedom < 1 or len(set(sizes)) < 3:
        return PowerLaw(exponent, None, None, len(x))
    residual = y - y.mean() - exponent * (x - x.mean())
    margin = float(student.ppf(0.975, freedom)) * float(np.sqrt(np.sum(residual**2) / freedom / spread))
    return PowerLaw(exponent, exponent - margin, exponent + margin, len(x))


# Growth of an estimator's error from one setting to another, of the same people, with a bootstrap interval.

Hands = Sequence[Mapping[str, Any]]
_TAILS = (2.5, 97.5)


class Growth(NamedTuple):
    """A ratio of RMSE in 3D with its 95 % interval over people, None of a single person."""

    ratio: float
    low: float | None
    high: float | None
    n_people: int


def error_growth(here: Mapping[str, Hands], there: Mapping[str, Hands], estimator: str) -> Growth | None:
    """Return the RMSE ``here`` over that ``there``, of the people that both have; None without any or without error.

    Both hold each person's hands (see `tis.deploy.compare.cells.sums.hand_sums`). A resample takes the same people
    on both sides, as the movements are the same. Oracle: errors written by hand, and a loop over resamples,
    test_error_growth.
    """
    people = [who for who in here if who in there]
    if not people:
        return None
    # (side, person, [sum of squares, ticks])
    parts = np.array([[_squares_and_ticks(side[who], estimator) for who in people] for side in (here, there)])
    ratio = float(_root_ratio(parts.sum(axis=1)[:, None])[0])
    if not np.isfinite(ratio):
        return None
    again = _root_ratio(parts[:, resampled(len(people))].sum(axis=2))
    if len(people) < 2 or not np.isfinite(again).all():
        return Growth(ratio, None, None, len(people))
    low, high = np.percentile(again, _TAILS)
    return Growth(ratio, float(low), float(high), len(people))


def _squares_and_ticks(hands: Hands, estimator: str) -> tuple[float, float]:
    sums = sums_of(hands, estimator)
    return float(sums.sse.sum()), float(sums.n)


def _root_ratio(parts: "np.ndarray[tuple[int, ...], np.dtype[np.float64]]") -> Any:
    """Return the ratio of root mean squares of sums (side, resample, [squares, ticks])."""
    with np.errstate(divide="ignore", invalid="ignore"):
        means = parts[..., 0] / parts[..., 1]
        return np.sqrt(means[0] / means[1])


ENOUGH: Final = 1.05
"""Error over that with all trials, up to which a number of training trials is enough."""

Figures = dict[str, Any]


def figures_of(computed: Computed, steps: Sequence[Stepped]) -> Figures:
    """Return the figures of a method; a measure without results is empty or None.

    Errors are in mm, times of steps in us, of trainings in s of processor time. Oracle: sums written by hand,
    test_figures.
    """
    method = computed.subject.method
    own = [entry for entry in steps if entry.method == method]
    data = _data(computed)
    return {
        "method": method,
        "gaps": list(computed.gaps),
        "n_seeds": computed.subject.extent.n_seeds if is_learned(method) else 1,
        "accuracy": [{"delay_ms": float(row["setting"]), **_scores(row)} for row in computed.rows("accuracy")],
        "loss": _loss(computed),
        "noise": _noise(computed, "noise"),
        "noise_trained": _noise(computed, "noise_trained"),
        "reliability": _reliability(computed),
        "data": data,
        "enough_trials": _enough(data),
        "adaptability": _adaptability(computed),
        "training_s": next((entry["train_s"] for entry in data if entry["n_trials"] == ALL), None),
        "step": _step(own),
        "fast": _fast(computed),
        "size": _size(computed, own),
        "exponents": _exponents(computed, own),
    }


def _scores(row: dict[str, Any]) -> Figures:
    """Return the scores of a row of a report that the table uses."""
    interval = row["ratio_to_hold_interval_95"] or (None, None)
    return {
        "ratio_to_hold": row["ratio_to_hold"],
        "low": interval[0],
        "high": interval[1],
        "rmse_3d_mm": row["rmse_3d_mm"],
        "r2_pct": row["r2_pct"],
        "n_people": row["n_people"],
    }


def _loss(computed: Computed) -> list[Figures]:
    rows = {row["setting"]: row for row in computed.rows("loss")}
    clean = loss_text(0, False)
    found = []
    for pct, bursts in losses_of(computed.subject.extent):
        setting = loss_text(pct, bursts)
        if setting in rows:
            growth = _growth(computed, "loss", setting, clean)
            found.append({"loss_pct": pct, "bursts": bursts, **_scores(rows[setting]), "growth": growth})
    return found


def _noise(computed: Computed, measure: Measure) -> list[Figures]:
    rows = computed.rows(measure)
    clean = next((row["setting"] for row in rows if _noise_mm(row) == 0), None)
    return [
        {
            "noise_mm": _noise_mm(row),
            **_scores(row),
            "growth": _growth(computed, measure, row["setting"], clean),
        }
        for row in rows
    ]


def _noise_mm(row: dict[str, Any]) -> float:
    return float(row["at"]["surgeon.sensor_noise_mm"])


def _growth(computed: Computed, measure: Measure, setting: str, clean: str | None) -> Figures | None:
    """Return the error at a setting over that at the one without loss or noise."""
    here, there = computed.hands(measure, setting), computed.hands(measure, clean)
    found = error_growth(here, there, computed.subject.estimator)
    return None if found is None else found._asdict()


def _reliability(computed: Computed) -> Figures | None:
    """Return percentiles of the error, ticks without an estimate, and coverage, on delay that varies and loses."""
    rows = computed.rows("reliability")
    if not rows:
        return None
    (row,) = rows
    return {
        **_scores(row),
        **{f"error_{name}_mm": value for name, value in row["error_mm"].items()},
        "missing_pct": 100 * row["n_missing"] / row["n_scored"],
        "coverage_pct": row["coverage_pct"],
    }


def _data(computed: Computed) -> list[Figures]:
    """Return errors and cost of training by number of trials, those with all of them last."""
    found = []
    for row in computed.rows("data"):
        about = computed.trainings("data", row["setting"])
        found.append(
            {
                "n_trials": row["setting"],
                **_scores(row),
                "n_rows": median(each["n_rows"] for each in about) if about else None,
                "train_s": median(each["process_s"] for each in about) if about else None,
            }
        )
    return found


def _enough(data: Sequence[Figures]) -> str | None:
    """Return the smallest number of trials whose error is within `ENOUGH` of that with all trials."""
    whole = next((entry["rmse_3d_mm"] for entry in data if entry["n_trials"] == ALL), None)
    if whole is None:
        return None
    return next((str(entry["n_trials"]) for entry in data if entry["rmse_3d_mm"] <= ENOUGH * whole), None)


def _adaptability(computed: Computed) -> list[Figures]:
    """Return the error after training on others over that after training on the same person's other trials."""
    own = computed.hands("adaptability", OWN)
    found = []
    for row in computed.rows("adaptability"):
        if row["setting"] != OWN:
            growth = error_growth(computed.hands("adaptability", row["setting"]), own, computed.subject.estimator)
            if growth is not None:
                found.append({"trained_on": row["setting"], **growth._asdict()})
    return sorted(found, key=lambda entry: entry["trained_on"] != OTHER_PERSON)


def _step(own: Sequence[Stepped]) -> Figures | None:
    """Return the times of a step with models of all rows, and the rates that follow."""
    entry = next((each for each in own if each.setting == ALL), None)
    if entry is None:
        return None
    names = ("p50_us", "p99_us", "rate_hz", "rate_both_hz")
    return {name: entry.figure(name) for name in names} | {"n_rounds": len(entry.plays)}


def _fast(computed: Computed) -> Figures | None:
    """Return error and processor time of a step at 1 kHz."""
    rows = computed.rows("fast")
    if not rows:
        return None
    (row,) = rows
    return {**_scores(row), **{f"step_{name}_us": value for name, value in row["step_us"].items()}}


def _size(computed: Computed, own: Sequence[Stepped]) -> list[Figures]:
    """Return error and cost by block rows."""
    steps = {entry.setting: entry.figure("p50_us") for entry in own if entry.measure == "size"}
    return [
        {
            "block_rows": int(row["setting"]),
            **_scores(row),
            "step_p50_us": steps.get(row["setting"]),
            "train_s": _train_s(computed, "size", row["setting"]),
        }
        for row in computed.rows("size")
    ]


def _train_s(computed: Computed, measure: Measure, setting: str) -> float | None:
    about = computed.trainings(measure, setting)
    return median(each["process_s"] for each in about) if about else None


def _exponents(computed: Computed, own: Sequence[Stepped]) -> dict[str, Figures | None]:
    """Return the exponents of training and step against rows and block rows."""
    if computed.subject.method == HOLD:
        return dict.fromkeys(("train_rows", "train_size", "step_rows", "step_size"))
    train_rows, train_size, step_rows, step_size = [], [], [], []
    rows_of: dict[str, float] = {}
    for row in computed.rows("data"):
        about = computed.trainings("data", row["setting"])
        train_rows += [(each["n_rows"], each["process_s"]) for each in about]
        rows_of[row["setting"]] = median(each["n_rows"] for each in about) if about else 0
    for row in computed.rows("size"):
        about = computed.trainings("size", row["setting"])
        train_size += [(float(row["setting"]), each["process_s"]) for each in about]
    for entry in own:
        p50_us = entry.figure("p50_us")
        if p50_us and entry.measure == "size":
            step_size.append((float(entry.setting), p50_us))
        elif p50_us and rows_of.get(entry.setting):
            step_rows.append((rows_of[entry.setting], p50_us))
    pairs = {"train_rows": train_rows, "train_size": train_size, "step_rows": step_rows, "step_size": step_size}
    return {name: _fitted(found) for name, found in pairs.items()}


def _fitted(pairs: Sequence[tuple[float, float]]) -> Figures | None:
    law = fit_power_law([x for x, _ in pairs], [y for _, y in pairs])
    return None if law is None else law._asdict()
