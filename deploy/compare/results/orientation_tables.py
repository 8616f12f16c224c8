"""Tables of a comparison's orientation methods: degrees beside hold's, the gripper likewise."""

from collections.abc import Mapping
from typing import Any, Final

HEAD: Final = ("orientation", "deg", "ratio", "95 %", "cover", "gripper rad", "ratio", "cover", "\u00b5s", "p99")
CAPTION: Final = (
    "deg: RMS of the angle between estimated and true orientation; gripper: RMS of its angle; each with its ratio to "
    "hold's and the per cent of the errors within the stated 95 % region"
)


def orientation_cells(row: Mapping[str, Any]) -> list[str]:
    """Return a method's row of the table."""
    interval = None if row["method"] == "hold" else row["ratio_to_hold_interval_95"]
    return [
        row["method"],
        _fixed(row["rms_deg"], 2),
        _fixed(row["ratio_to_hold"], 3),
        "-" if interval is None else f"{interval[0]:.2f}-{interval[1]:.2f}",
        _fixed(row["coverage_pct"], 1),
        _fixed(row["gripper_rms_rad"], 4),
        _fixed(row["gripper_ratio_to_hold"], 3),
        _fixed(row["gripper_coverage_pct"], 1),
        *(_fixed(row["step_us"][name], 1) for name in ("p50", "p99")),
    ]


def orientation_ratios(report: Mapping[str, Any], degrees: bool = True) -> tuple[list[str], list[list[str]]]:
    """Return the head and the rows of ratios to hold, and of ``degrees``: methods against settings."""
    settings = [about["setting"] for about in report["settings"] if about["n_cells"]]
    known = {(row["method"], row["setting"]): row for row in report["orientation"]}
    rows = []
    for name in dict.fromkeys(row["method"] for row in report["orientation"]):
        found = [known.get((name, setting)) for setting in settings]
        rows.append([name, *(_cell(row, degrees) for row in found)])
    head = "orientation, deg (ratio)" if degrees else "orientation"
    return [head, *(str(setting) for setting in settings)], rows


def _cell(row: Mapping[str, Any] | None, degrees: bool) -> str:
    ratio = "-" if row is None else _fixed(row["ratio_to_hold"], 3)
    return ratio if row is None or not degrees else f"{_fixed(row['rms_deg'], 2)} ({ratio})"


def _fixed(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
