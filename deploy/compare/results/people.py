"""People of a comparison: the units over which intervals are resampled, as their trials are not independent."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from tis.common.runtime.recordings import person_of
from tis.common.scenario.source import RecordedSource
from tis.deploy.compare.cells.cell import Cell
from tis.deploy.compare.results.pooled import ENOUGH_PEOPLE, range_holds_median_pct


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
        return "There is no interval, since intervals are over people and this is a single one."
    return (
        f"The 95 % intervals rest on {n_people} people only. They cannot be wider than the range of these people's "
        "own figures, which holds the median of all people with a probability of "
        f"{range_holds_median_pct(n_people):.0f} %; it takes {ENOUGH_PEOPLE} people for more than 95 %."
    )


def band_words(report: Mapping[str, Any]) -> str:
    """Return what the bands of a report's figures are, with the number of people and what so few of them mean."""
    n_people = fewest(report["rows"])
    if n_people < 2:
        return "No bands: intervals are over people, and this is a single one."
    who = f"{n_people} people{', one for each seed' * (report['source'] == 'synthetic')}"
    few = f". So few cover less than 95 %: at most {range_holds_median_pct(n_people):.0f} %"
    return f"Bands: 95 % bootstrap intervals over {who}{few * (n_people < ENOUGH_PEOPLE)}."
