"""A synthetic population: people who differ in speed, pauses, reach, tremor and gripper, with several trials each.

A person is a `SyntheticSource`; people differ only in the fields of `SPREAD`, and a person's trials share them. All
are isotropic: what moves differently along one axis is no person of this population.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np
import scipy

from tis.common.scenario.source import SyntheticSource
from tis.common.sources.provenance import digest_of_synthetic
from tis.common.sources.synthetic import synthesise
from tis.common.sources.trajectory import Recording
from tis.common.streams import Stream

MAX_TRIALS: Final = 999
"""Trials of a person, and people of a population, so that no two movements of a population share a seed."""

SPREAD: Final[dict[str, float]] = {
    "movement_s": 0.07,
    "reach_mm": 0.36,
    "pause_s": 0.6,
    "tremor_mm": 0.4,
    "tremor_hz": 0.08,
    "gripper_open_rad": 0.07,
    "gripper_hold_s": 0.4,
}
"""Standard deviation between people of the logarithm of each field that differs.

Those of movement, reach and pause are the best of a grid for `RECORDED_BETWEEN`: 240 people deviate 0.88, 1.49, 0.93,
0.74 and 1.04 times as much. Those of the gripper are of how far and how often recorded grippers open. Those of the
tremor, which rows at 30 Hz do not show, are assumed.
"""

RECORDED_BETWEEN: Final[dict[str, float]] = {
    "hold-last error at 1000 ms, mm": 0.245,
    "speed p50, mm/s": 0.252,
    "speed rms, mm/s": 0.270,
    "time slower than 2 mm/s, share": 0.202,
    "velocity power up to 1 Hz, share": 0.038,
}
"""Standard deviation between people of the logarithm of statistics of `calibration`, without that within people.

Of 19 JIGSAWS suturing trials of four people, the mean of both arms. Four people determine a deviation no better than
to 0.57 to 3.7 times its estimate, with 95 % (chi-square, 3 degrees of freedom); within people it is 0.06 to 0.12.
"""

_FARTHEST: Final = 2.5  # standard deviations: no person is odder than the oddest of a hundred
_DIGITS: Final = 4  # so that a person can be written into a scenario exactly


def person(source: SyntheticSource, seed: int, index: int) -> SyntheticSource:
    """Return person ``index`` (>= 0) of the population ``seed``, drawn about ``source``.

    Each field of `SPREAD` is lognormal about the source's value, within 2.5 standard deviations and the field's
    limits, rounded to 4 significant digits; a field of 0 remains 0. Other people do not matter. Oracle: literal
    draws; quantiles over many people.
    """
    drawn: dict[str, float] = {}
    for name, spread in SPREAD.items():
        score = float(scipy.special.ndtri(Stream.named(seed, f"population/{name}").uniform(index)))
        factor = np.exp(spread * np.clip(score, -_FARTHEST, _FARTHEST))
        drawn[name] = _within_limits(name, float(f"{getattr(source, name) * factor:.{_DIGITS}g}"))
    return source.model_copy(update=drawn)


def trial_seed(seed: int, index: int, trial: int) -> int:
    """Return the seed of trial ``trial`` (1 to 999) of person ``index`` (0 to 998) of the population ``seed``.

    All trials of all populations have different seeds. Raises `ValueError` outside these limits.
    """
    if not (0 <= index < MAX_TRIALS and 1 <= trial <= MAX_TRIALS):
        raise ValueError(f"must be a person from 0 to {MAX_TRIALS - 1} and a trial from 1 to {MAX_TRIALS}")
    return ((MAX_TRIALS + 1) * seed + index + 1) * (MAX_TRIALS + 1) + trial


def population(
    source: SyntheticSource, seed: int, n_people: int, n_trials: int, rate_hz: int, n_rows: int
) -> Iterator[Recording]:
    """Yield ``n_trials`` recordings of each of ``n_people``, person by person.

    Each is the movement of `person` for the seed `trial_seed`. More people, trials or rows extend the same
    population. Raises as `trial_seed` does. Oracle: the statistics between and within recorded people.
    """
    for index in range(n_people):
        one = person(source, seed, index)
        for trial in range(1, n_trials + 1):
            its_seed = trial_seed(seed, index, trial)
            recording = synthesise(one, its_seed, rate_hz, n_rows, 0)
            yield replace(
                recording,
                label=f"synthetic person {index + 1} of seed {seed}, trial {trial}",
                digest=digest_of_synthetic(one, its_seed, rate_hz),
            )


def _within_limits(name: str, value: float) -> float:
    for limit in SyntheticSource.model_fields[name].metadata:
        value = max(value, getattr(limit, "ge", value))
        value = min(value, getattr(limit, "le", value))
    return value
