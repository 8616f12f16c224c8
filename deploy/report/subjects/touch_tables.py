"""Touch in words and as a table: stability with theory's limit beside it, and what the hand felt."""

from collections.abc import Mapping, Sequence
from typing import Final

from tis.common.channels import Hand
from tis.deploy.present.numbers import number, percent, significant
from tis.deploy.present.table import Column, Table
from tis.deploy.report.section import Statistics
from tis.deploy.report.subjects.touch import MJ_PER_J, Stability, TouchFigures

STABILITY_WORDS: Final[Mapping[Stability, str]] = {
    "stable": "stable", "unstable": "unstable",
    "not_decidable": "not decidable (too little contact, or no intention told)",
}  # fmt: skip
_MEANINGS: Final[Mapping[Stability, str]] = {
    "stable": "The loop of hand, network and arm was stable",
    "unstable": "The loop of hand, network and arm was unstable: the hand swung wider and wider, or far too fast",
    "not_decidable": "Whether the loop of hand, network and arm is stable is not decidable: it touched too little, "
    "or its device does not tell what the hand intends",
}
_NOTE: Final = (
    "Energy given: beyond what the hand had put in; 0 where the coupling was passive. Felt: slope of the hand's "
    "force over its depth. Beyond the deadband: delay, loss, limits and fading"
)


def energy_text(energy_mj: float) -> str:
    """Return an energy with its unit, J from 1000 mJ on."""
    return number(energy_mj, " mJ") if energy_mj < MJ_PER_J else number(energy_mj / MJ_PER_J, " J")


def stability_text(found: TouchFigures) -> str:
    """Return whether the loop was stable, with the wall's stiffness and the limit that theory has for it."""
    text = STABILITY_WORDS[found.stability]
    if found.stiffness_n_m is not None:
        text += f" at {significant(found.stiffness_n_m)} N/m"
    if found.limit_n_m is not None:
        return f"{text}; in theory up to {significant(found.limit_n_m)} N/m"
    return text if found.stiffness_n_m is None else f"{text}; theory tells no limit for it"


def touch_text(touch: Mapping[Hand, TouchFigures]) -> str:
    """Return a line on each hand: stability, stiffness felt, and energy given; "" without touch."""
    texts = []
    for hand, found in touch.items():
        felt = (
            ""
            if found.shown_over_true is None or found.stability != "stable"
            else f"; {percent(found.shown_over_true)} % of it felt"
        )
        given = f"; {energy_text(found.energy_mj)} given to the hand"
        texts.append(f"{f'{hand}: ' if len(touch) > 1 else ''}{stability_text(found)}{felt}{given}")
    return "; ".join(texts)


def verdict_text(found: TouchFigures) -> str:
    """Return whether a hand's loop was stable, and what theory expects, in words."""
    text = _MEANINGS[found.stability]
    if found.stiffness_n_m is not None:
        text += f", at a wall of {significant(found.stiffness_n_m)} N/m"
    if found.limit_n_m is not None:
        trip_ms = found.limit_round_trip_ms
        at = "" if trip_ms is None else f", at its round trip of {number(trip_ms, ' ms')}"
        text += f". Theory expects it to swing from {significant(found.limit_n_m)} N/m on{at}"
    return f"{text}."


def answer_text(found: TouchFigures) -> str:
    """Return whether a hand's loop was stable, what theory expects, and what the hand felt, in words."""
    text = verdict_text(found)
    if found.shown_over_true is not None and found.stability == "stable":
        text += f" The hand felt {percent(found.shown_over_true)} % of the stiffness."
    return f"{text} The coupling gave the hand at most {energy_text(found.energy_mj)} beyond what it had put in."


def touch_tables(touch: Mapping[Hand, TouchFigures]) -> list[Table]:
    """Return a table of each hand's figures."""
    columns = ("figure", Column("value", words=True, wraps=True))
    return [Table(f"Touch, {hand} hand", columns, _rows(found), _NOTE) for hand, found in touch.items()]


def _rows(found: TouchFigures) -> Sequence[tuple[str, str]]:
    felt = "-" if found.shown_over_true is None else f"{percent(found.shown_over_true)} %"
    return [
        ("loop", stability_text(found)),
        ("stiffness felt, of the true one", felt),
        ("energy given to the hand", energy_text(found.energy_mj)),
        ("largest force on what the arm touched", number(found.peak_force_n, " N")),
        ("error of the force shown", _spread(found.force_error_n, " N")),
        ("beyond the deadband", _spread(found.force_beyond_n, " N")),
        ("delay of a force", _spread(found.force_delay_ms, " ms")),
        ("round trip", _spread(found.round_trip_ms, " ms")),
        ("drift of the set point", number(found.drift_mm, " mm")),
        ("forces", _packets(found.force_packets)),
        ("samples of the hand", _packets(found.motion_packets)),
    ]


_NAMES: Final = {"rms": "RMS", "p50": "median", "p95": "p95", "max": "largest"}


def _spread(values: Statistics, unit: str) -> str:
    return ", ".join(f"{words} {number(values[name], unit)}" for name, words in _NAMES.items() if name in values)


def _packets(counted: Mapping[str, int]) -> str:
    return f"{number(counted['sent'])} sent, {number(counted['suppressed'])} kept back by the deadband"
