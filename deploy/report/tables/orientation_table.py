"""Tables of the orientation methods: errors in degrees beside hold's, the gripper in rad likewise."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from tis.deploy.report.tables.html_tables import table
from tis.deploy.report.tables.numbers import number

HEAD: Final = (
    "orientation", "RMS, \u00b0", "share of hold's, %", "p95, \u00b0", "max, \u00b0", "in the 95 % interval, %",
    "gripper RMS, rad", "share of hold's, %", "step, median, \u00b5s",
)  # fmt: skip


def orientation_table(
    orientation_deg: Mapping[str, Any], gripper_rad: Mapping[str, Any], which: str, active: str
) -> str:
    """Return one hand's orientation methods beside hold; "" without any."""
    rows = [tuple(row) for row in orientation_rows(orientation_deg, gripper_rad)]
    return table(f"Orientation and gripper at the tick, {which}", HEAD, rows, marked=active) if rows else ""


def orientation_rows(orientation_deg: Mapping[str, Any], gripper_rad: Mapping[str, Any]) -> Iterator[Sequence[str]]:
    """Yield a row for each method; coverage is the mean over the axes of the estimated frame."""
    for name, entry in orientation_deg.items():
        if entry["rms"] is None:
            continue
        gripper = gripper_rad.get(name) or {}
        covered = [share for share in (entry.get("nees") or {}).get("coverage_pct", ()) if share is not None]
        yield (
            name,
            number(entry["rms"]),
            _percent(entry["ratio_to_hold"]),
            number(entry["p95"]),
            number(entry["max"]),
            number(sum(covered) / len(covered)) if covered else "-",
            number(gripper.get("rms")),
            _percent(gripper.get("ratio_to_hold")),
            number(entry["step_us"]["p50"]),
        )


def _percent(ratio: float | None) -> str:
    return "-" if ratio is None else f"{100 * ratio:.0f}"
