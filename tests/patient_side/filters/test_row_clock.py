"""The phase of the clock behind the rows: of rows picked from a source of known rate, and of even ones."""

import cmath
from itertools import pairwise
from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.patient_side.filters.row_clock import NO_PHASE, Phasor, RowClock, evidence_of, terms_of
from tis.patient_side.identification.correction_rows import find_row_clock
from tis.patient_side.linear_system import Array

RATIO = 51.326 / 30
"""Samples of the source per row."""
CYCLES = 2 - RATIO


def path(n_rows: int, ratio: float | None, seed: int = 0) -> Array:
    """A smooth irregular movement; with a ratio, rows hold the newest sample of a source."""
    rows = np.arange(n_rows + 1.0)
    at = rows if ratio is None else np.floor(rows * ratio + 0.3) / ratio
    rng = np.random.default_rng(seed)
    periods, phases = rng.uniform(15, 120, (12, 3)), rng.uniform(0, 2 * np.pi, (12, 3))
    return np.asarray(0.005 * np.sin(2 * np.pi * at[:, None, None] / periods + phases).sum(axis=1))


def last_increments(y: Array) -> Array:
    """The last four increments of each row, newest first (N - 4, 12)."""
    steps = np.diff(y, axis=0)
    return np.hstack([steps[3 - j : len(steps) - j] for j in range(4)])


def tracked(clock: RowClock, increments: Array) -> list[Phasor]:
    found, now = [], NO_PHASE
    for each in increments.tolist():
        now = clock.after(now, 1, each, 1.0)
        found.append(now)
    return found


def test_the_frequency_of_a_source_is_found_and_even_rows_have_none() -> None:
    for ratio, cycles in ((RATIO, CYCLES), (1.6, 0.4), (None, 0.0)):
        evidence = [evidence_of(last_increments(path(900, ratio, s)), np.ones(897), 1e-3)[0] for s in (1, 2)]
        assert find_row_clock(evidence) == pytest.approx(cycles, abs=2e-4)


def test_of_noise_no_frequency_is_found() -> None:
    rng = np.random.default_rng(3)
    for n_rows in (30, 300, 3000):
        assert find_row_clock([rng.normal(size=n_rows) for _ in range(4)]) == 0.0
    assert find_row_clock([np.zeros(100), np.empty(0)]) == 0.0


def test_the_phase_turns_with_the_clock_and_missing_rows_do_not_stop_it() -> None:
    clock = RowClock(CYCLES, 1e-3)
    found = tracked(clock, last_increments(path(900, RATIO)))
    turned = [cmath.phase(two[0] / one[0]) / (2 * pi) for one, two in pairwise(found[600:])]
    assert np.array(turned) == pytest.approx(CYCLES, abs=0.02)
    # Twenty rows later, of which none has arrived.
    later = clock.after(found[700], 20, [], 1.0)
    assert abs(cmath.phase(later[0] / found[720][0])) < 0.3


def test_its_terms_tell_whether_the_next_row_is_one_source_sample_away_or_two() -> None:
    increments, clock = last_increments(path(1500, RATIO)), RowClock(CYCLES, 1e-3)
    terms = terms_of(clock, increments, np.ones(len(increments)))[300:-1]
    samples = np.diff(np.floor(np.arange(1501.0) * RATIO + 0.3))[304:]
    regressors = np.hstack([terms, np.ones((len(terms), 1))])
    left = samples - regressors @ np.linalg.lstsq(regressors, samples)[0]
    assert set(samples.tolist()) == {1.0, 2.0}
    assert np.var(left) < 0.2 * np.var(samples)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 99), size=st.sampled_from([0.0, 1e-6, 1e-3, 1.0]))
def test_arrays_say_what_plain_numbers_do(seed: int, size: float) -> None:
    rng = np.random.default_rng(seed)
    increments, activity = size * rng.normal(size=(40, 12)), rng.uniform(0.1, 4, 40)
    clock, now, rows = RowClock(CYCLES, 1e-3), NO_PHASE, []
    for each, factor in zip(increments.tolist(), activity.tolist(), strict=True):
        now = clock.after(now, 1, each, factor)
        rows.append(clock.terms(now))
    assert terms_of(clock, increments, activity) == pytest.approx(np.array(rows), abs=1e-9)
    assert np.all(np.abs(rows) <= 1.0)


def test_a_gap_is_as_many_rows_without_evidence() -> None:
    clock, one = RowClock(CYCLES, 1e-3), (0.3 + 0.1j, 2.0)
    step_by_step = one
    for _ in range(5):
        step_by_step = clock.after(step_by_step, 1, [], 1.0)
    total, weight = clock.after(one, 5, [], 1.0)
    assert total == pytest.approx(step_by_step[0])
    assert weight == pytest.approx(step_by_step[1])


def test_at_rest_there_is_no_evidence() -> None:
    clock = RowClock(CYCLES, 0.0)
    assert clock.after(NO_PHASE, 1, [0.0] * 12, 1.0) == (0j, 0.0)
    assert clock.terms(NO_PHASE) == [0.0] * 8
