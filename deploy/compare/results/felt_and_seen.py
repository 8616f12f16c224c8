"""Touch and sight at each setting of a comparison: rows of the report, and their table."""

from collections.abc import Mapping, Sequence
from typing import Any, Final, get_args

from tis.common.units import NS_PER_MS
from tis.deploy.compare.cells.sums import merged, percentile
from tis.deploy.present.numbers import NONE, number
from tis.deploy.present.table import Column, Table
from tis.deploy.report.subjects.touch import Stability

CAPTION: Final = (
    "eye: hand to eye in ms, median and p99 over all commands of all twins; whole: per cent of the frames that came "
    "whole; frozen: per cent of the time; stable: hands whose loop is stable, of those that can be decided; N: the "
    "largest force on what an arm touched; mJ: the most energy given to a hand. The arm follows the scenario's "
    "active estimator, whatever is compared"
)
_COLUMNS: Final = tuple(Column(head, show=number) for head in ("eye", "p99", "whole", "frozen"))
_FELT: Final = (Column("stable"), Column("N", show=number), Column("mJ", show=number))


def felt_and_seen_row(at: Mapping[str, Any], results: Sequence[Mapping[str, Any]]) -> dict[str, Any] | None:
    """Return the figures of a setting's cells together; None where nothing is felt and nothing seen.

    Oracle: the summary of a twin, and two cells added by hand, test_felt_and_seen.
    """
    seen = [result["seen"] for result in results if result.get("seen")]
    felt = [hand for result in results for hand in result.get("felt", ())]
    if not seen and not felt:
        return None
    delays_ns = merged(one["hand_to_eye_ns"] for one in seen)
    eye_ms = {f"p{p}": percentile(delays_ns, p) for p in (50, 99)}
    return {
        **at,
        "hand_to_eye_ms": {name: None if ns is None else ns / NS_PER_MS for name, ns in eye_ms.items()},
        "decodable_pct": _share_pct(seen, "n_whole", "n_frames"),
        "freeze_pct": _share_pct(seen, "frozen_ns", "watched_ns"),
        "n_freezes": sum(one["n_freezes"] for one in seen) if seen else None,
        **{f"n_{how}": sum(hand["stability"] == how for hand in felt) for how in get_args(Stability)},
        "peak_force_n": max((hand["peak_force_n"] for hand in felt), default=None),
        "energy_mj": max((hand["energy_mj"] for hand in felt), default=None),
    }


def _share_pct(seen: Sequence[Mapping[str, int]], part: str, whole: str) -> float | None:
    total = sum(one[whole] for one in seen)
    return 100.0 * sum(one[part] for one in seen) / total if total else None


def felt_and_seen_table(rows: Sequence[Mapping[str, Any]], title: str = "") -> Table:
    """Return a line for each setting; columns of what no setting has are left out."""
    has_seen = any(row["hand_to_eye_ms"]["p50"] is not None or row["n_freezes"] is not None for row in rows)
    has_felt = any(row["peak_force_n"] is not None for row in rows)
    cells = [
        [str(row["setting"] or NONE), *(_seen(row) if has_seen else ()), *(_felt(row) if has_felt else ())]
        for row in rows
    ]
    return Table(title, ("setting", *_COLUMNS * has_seen, *_FELT * has_felt), cells)


def _seen(row: Mapping[str, Any]) -> list[Any]:
    eye_ms = row["hand_to_eye_ms"]
    return [eye_ms["p50"], eye_ms["p99"], row["decodable_pct"], row["freeze_pct"]]


def _felt(row: Mapping[str, Any]) -> list[Any]:
    decided = row["n_stable"] + row["n_unstable"]
    return [f"{row['n_stable']} of {decided}" if decided else NONE, row["peak_force_n"], row["energy_mj"]]
