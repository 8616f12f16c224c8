"""Table of the sides' clocks against netem's, and their uncertainty."""

from collections.abc import Mapping
from typing import Any, Final

from tis.deploy.report.tables.html_tables import table
from tis.deploy.report.tables.numbers import number

_KINDS: Final = {
    "reference": "the reference",
    "shared": "the reference's own: same host",
    "exchanged": "compared by exchanges",
    "unknown": "never compared",
}
_ONE_CLOCK: Final = ("reference", "shared")


def clock_table(clocks: Mapping[str, Mapping[str, Any]]) -> str:
    """Return a row for each side of the summary's ``clocks``, and a note on one-way figures.

    Where all sides read one clock the note stands alone.
    """
    note = f'<p class="note">{_note(clocks)}</p>'
    if all(clock["kind"] in _ONE_CLOCK for clock in clocks.values()):
        return note
    rows = [
        (side, _KINDS.get(clock["kind"], clock["kind"]), *_comparison(clock), _disciplined(clock["discipline"]))
        for side, clock in clocks.items()
    ]
    head = (
        "side", "clock", "offset, ms", "drift, ppm", "known within, \u00b5s", "exchanges",
        "shortest round trip, \u00b5s", "synchronised by its host",
    )  # fmt: skip
    return table("Clocks against netem's", head, rows, texts=(1, 7)) + note


def _comparison(clock: Mapping[str, Any]) -> list[str]:
    """Return the five figures of a comparison; dashes for the reference clock itself."""
    if clock["kind"] in _ONE_CLOCK:
        return ["-"] * 5
    return [
        number(clock["offset_ms"]),
        _with_margin(clock["drift_ppm"], clock["drift_uncertainty_ppm"]),
        number(clock["uncertainty_us"]),
        number(clock["n_exchanges"]),
        number(clock["min_round_trip_us"]),
    ]


def _note(clocks: Mapping[str, Mapping[str, Any]]) -> str:
    kinds = {clock["kind"] for clock in clocks.values()}
    if not clocks:
        return "All sides ran on one clock, that of virtual time: one-way figures are exact."
    if "unknown" in kinds:
        return "A clock was never compared with netem's, so delays between its host and another are not known."
    if "exchanged" not in kinds:
        return (
            "All sides ran on one host and read one clock, netem's: there was nothing to compare, and clocks add no "
            "uncertainty to one-way figures."
        )
    known = [float(clock["uncertainty_us"]) for clock in clocks.values() if clock["kind"] == "exchanged"]
    return (
        f"One-way figures between hosts may be wrong by up to {number(sum(known))} \u00b5s: half the shortest round "
        "trips, and what the clocks may have wandered between them. A figure smaller than that cannot be resolved."
    )


def _with_margin(value: float | None, uncertainty: float | None) -> str:
    return number(value) + (f" \u00b1 {number(uncertainty)}" if uncertainty else "")


def _disciplined(discipline: Mapping[str, Any] | None) -> str:
    if discipline is None:
        return "not known"
    return "yes" if discipline.get("synchronised") else "no"
