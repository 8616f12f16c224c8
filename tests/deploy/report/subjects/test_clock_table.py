"""The clocks in a table, and the sentence that says what they mean for one-way figures."""

from typing import Any

import pytest

from tests.deploy.report.outline import Outline
from tests.deploy.report.partial import part
from tis.deploy.report.subjects.clocks import ClockFigures, clock_table

NETEM = {
    "kind": "reference", "offset_ms": 0.0, "drift_ppm": 0.0, "drift_uncertainty_ppm": 0.0, "uncertainty_us": 0.0,
    "n_exchanges": 0, "min_round_trip_us": None, "discipline": {"synchronised": True},
}  # fmt: skip
SURGEON = {
    "kind": "exchanged", "offset_ms": 3000.25, "drift_ppm": 50.0, "drift_uncertainty_ppm": 1.5,
    "uncertainty_us": 81.0, "n_exchanges": 240, "min_round_trip_us": 115.0, "discipline": None,
}  # fmt: skip
UNKNOWN = dict.fromkeys(NETEM) | {"kind": "unknown", "n_exchanges": 0}


def _table(clocks: dict[str, Any]) -> str:
    found = clock_table({side: part(ClockFigures, clock) for side, clock in clocks.items()})  # type: ignore[misc]
    return found.html() if found.rows else found.note


def test_a_row_holds_what_is_known_of_a_clock() -> None:
    page = Outline(_table({"netem": NETEM, "surgeon": SURGEON}))
    rows = [text for _, text in page.all("tr")]
    assert rows[1] == "netemthe reference-----yes"
    assert rows[2] == "surgeoncompared by exchanges300050.00 ± 1.5081.00240115.0not known"
    assert "may be wrong by up to 81.00 µs" in page.text


@pytest.mark.parametrize(
    ("clocks", "words"),
    [
        ({}, "that of virtual time"),
        ({"netem": NETEM, "surgeon": NETEM | {"kind": "shared"}}, "read one clock, netem's"),
        ({"netem": NETEM, "surgeon": UNKNOWN, "patient": SURGEON}, "are not known"),
    ],
)
def test_the_sentence_says_what_that_means(clocks: dict[str, Any], words: str) -> None:
    assert words in _table(clocks)


def test_one_clock_for_all_needs_no_table() -> None:
    assert "<table" not in _table({"netem": NETEM, "surgeon": NETEM | {"kind": "shared"}})
    mixed = Outline(_table({"netem": NETEM, "surgeon": SURGEON, "patient": NETEM | {"kind": "shared"}}))
    assert [text for _, text in mixed.all("tr")][3] == "patientthe reference's own: same host-----yes"
