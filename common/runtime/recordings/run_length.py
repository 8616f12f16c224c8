"""First row and length of a run within its recording."""

import math
from pathlib import Path

from tis.common.errors import Fault, InputError
from tis.common.scenario import Scenario


def first_row(scenario: Scenario) -> int:
    """Return the row that becomes sample 0; raises `InputError` when training rows would be scored."""
    identification, start = scenario.identification, scenario.source.start
    first = identification.train_samples if identification.train == "own_head" else 0
    if start == "auto":
        return first
    if start < first:
        rule = f"must be auto or at least train_samples = {first}, since own_head trains on the rows before"
        raise InputError(Fault(f"scenario {scenario.name}", "source.start", rule, start))
    return start


def too_short(scenario: Scenario, file: Path, n_rows: int) -> Fault | None:
    """Return the fault of a recording with fewer rows than the run needs: its samples, and one for truth."""
    start = first_row(scenario)
    needed = start + scenario.n_samples + 1
    if n_rows >= needed:
        return None
    longest = n_rows - start - 1
    if longest < 1:
        advice = "it is too short for any duration_s with this start and these training rows"
    else:
        # rounded down, or the suggested value would be too long as well
        seconds = math.floor(1000 * longest / scenario.rate_hz) / 1000
        advice = f"duration_s can be at most {seconds:.3f}, or auto to play all of it"
    parts = f"{start} before the start + {scenario.n_samples} samples of {scenario.duration_s:g} s + 1"
    return Fault(str(file), "", f"must have {needed} rows ({parts}); {advice}", n_rows)


def longest_s(scenario: Scenario, file: Path, n_rows: int) -> float:
    """Return the duration of a run that plays all rows from the first one on; raises `InputError` for none."""
    longest = n_rows - first_row(scenario) - 1
    if longest < 1:
        rule = f"auto finds no row to play: {file} has {n_rows} rows, and the run begins at row {first_row(scenario)}"
        raise InputError(Fault(f"scenario {scenario.name}", "duration_s", rule))
    return longest / scenario.rate_hz
