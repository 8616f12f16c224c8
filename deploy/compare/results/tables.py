"""Tables of a comparison: for a terminal, as Markdown, and as CSV."""

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from tis.deploy.compare.results.pooled import interval_note
from tis.deploy.present.numbers import broken_name, number
from tis.patient_side.provenance import IN_SAMPLE

# Tables of a comparison's orientation methods: degrees beside hold's, the gripper likewise.

TURN_HEAD: Final = ("orientation", "deg", "ratio", "95 %", "cover", "gripper rad", "ratio", "cover", "\u00b5s", "p99")
TURN_CAPTION: Final = (
    "deg: RMS of the angle between estimated and true orientation; gripper: RMS of its angle; each with its ratio to "
    "hold's and the per cent of the errors within the stated 95 % region"
)


def orientation_cells(row: Mapping[str, Any]) -> list[str]:
    """Return a method's row of the table."""
    interval = None if row["method"] == "hold" else row["ratio_to_hold_interval_95"]
    return [
        row["method"],
        _digits(row["rms_deg"], 2),
        _digits(row["ratio_to_hold"], 3),
        "-" if interval is None else f"{interval[0]:.2f}-{interval[1]:.2f}",
        _digits(row["coverage_pct"], 1),
        _digits(row["gripper_rms_rad"], 4),
        _digits(row["gripper_ratio_to_hold"], 3),
        _digits(row["gripper_coverage_pct"], 1),
        *(_digits(row["step_us"][name], 1) for name in ("p50", "p99")),
    ]


def orientation_ratios(report: Mapping[str, Any], degrees: bool = True) -> tuple[list[str], list[list[str]]]:
    """Return the head and the rows of ratios to hold, and of ``degrees``: methods against settings."""
    settings = [about["setting"] for about in report["settings"] if about["n_cells"]]
    known = {(row["method"], row["setting"]): row for row in report["orientation"]}
    rows = []
    for name in dict.fromkeys(row["method"] for row in report["orientation"]):
        found = [known.get((name, setting)) for setting in settings]
        rows.append([name, *(_turn_cell(row, degrees) for row in found)])
    head = "orientation, deg (ratio)" if degrees else "orientation"
    return [head, *(str(setting) for setting in settings)], rows


def _turn_cell(row: Mapping[str, Any] | None, degrees: bool) -> str:
    ratio = "-" if row is None else _digits(row["ratio_to_hold"], 3)
    return ratio if row is None or not degrees else f"{_digits(row['rms_deg'], 2)} ({ratio})"


def _digits(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


# The ratios of a comparison as a LaTeX table, for papers: `booktabs`, numbers with their intervals.

_COMMANDS: Final = {
    "\\": r"\textbackslash{}",
    "^": r"\textasciicircum{}",
    "~": r"\textasciitilde{}",
    "×": r"$\times$",
    "µ": r"$\mu$",
    "²": r"$^2$",
}
_SPECIAL: Final = str.maketrans({**{char: f"\\{char}" for char in "&%$#_{}"}, **_COMMANDS})


def latex_table(report: dict[str, Any]) -> str:
    """Return a ``tabular`` of the ratios to hold, the command in a comment above it."""
    head, rows = ratios(report)
    # A command that is longer than a line stays a comment.
    command = " ".join(report["command"].split())
    n_text = len(report["axes"]) if len(report["axes"]) > 1 else 1
    about = (f"% {command}", "% RMSE in 3D over that of hold, with 95 % bootstrap intervals over people")
    return tabular(head, rows, *about, n_text=n_text)


def tabular(head: Sequence[str], rows: Sequence[Sequence[str]], *comments: str, n_text: int = 1) -> str:
    """Return a ``tabular`` in the style of `booktabs`, comments above it; the first ``n_text`` columns are texts."""
    lines = [
        *comments,
        rf"\begin{{tabular}}{{{'l' * n_text}{'r' * (len(head) - n_text)}}}",
        r"\toprule",
        _line(head),
        r"\midrule",
        *map(_line, rows),
        r"\bottomrule",
        r"\end{tabular}",
    ]
    return "\n".join(lines) + "\n"


def _line(cells: Sequence[str]) -> str:
    return " & ".join(cell.translate(_SPECIAL) for cell in cells) + r" \\"


Rows = Sequence[dict[str, Any]]

# fits into 80 columns for every estimator
_HEAD = ("estimator", "R\u00b2% x", "y", "z", "mm", "ratio", "95 %", "cover", "\u00b5s", "p99", "train")
_CAPTION = (
    "mm: RMSE in 3D; ratio: that over hold's, then its 95 % bootstrap interval over people; cover: per cent of the "
    "errors within the 95 % ellipsoid; \u00b5s: CPU time of a step, median and p99; train: s of its identification; "
    "age: over the scored ticks, how old the freshest sample is that has arrived, command or arm's position"
)
_OBSERVER: Final = (
    "Topology observer: the commands pass clean, so the freshest sample is mostly a command; the arm's positions are "
    "as late as the network makes them."
)
_NAME_WIDTH: Final = 18
_MAX_COLUMNS: Final = 8
_MAX_SHOWN: Final = 12
"""Settings up to which a terminal shows a table each; of more it shows the ratios."""
_NORMALIZED = "x y z / range"


def view(report: dict[str, Any]) -> RenderableType:
    """Return the comparison for a terminal: a table per setting and, with a sweep, a table of ratios."""
    parts: list[RenderableType] = [Text(headline(report), style="bold")]
    settings = [about for about in report["settings"] if about["n_cells"]]
    of_setting, turning = _by_setting(report["rows"]), _by_setting(report["orientation"])
    for about in settings if len(settings) <= _MAX_SHOWN else ():
        cells = [
            [broken_name(name, _NAME_WIDTH), *numbers] for name, *numbers in map(_cells, of_setting[about["setting"]])
        ]
        parts += [Text(f"\n{_title(about)}"), _table(_HEAD, cells)]
        if about["setting"] in turning:
            parts.append(_table(TURN_HEAD, map(orientation_cells, turning[about["setting"]])))
    many = f"table.md has a table of each of {len(settings)} settings."
    caption = f"{_CAPTION}. {TURN_CAPTION}" if len(settings) <= _MAX_SHOWN else many
    parts += [Text(f"\n{note}", style="dim") for note in (caption, *_notes(report))]
    if len(settings) > 1:
        parts += [Text(f"\nRatio to hold, by {report['sweep']}"), _table(*ratios(report, intervals=False))]
        if report["orientation"] and len(settings) <= _MAX_COLUMNS:
            parts.append(_table(*orientation_ratios(report, degrees=False)))
    return Group(*parts)


def headline(report: dict[str, Any]) -> str:
    """Return scenario, trials and training as a sentence."""
    n_trials, n_asked, seeds = len(report["trials"]), report["n_trials_asked"], report["n_seeds"]
    count = f"{n_trials}" if n_trials == n_asked else f"{n_trials} of {n_asked}"
    if report["source"] == "synthetic":
        units = f"{count} synthetic movements"
    else:
        of = f", {seeds} seeds each" if seeds > 1 else ""
        units = f"{count} trial{'s' if n_asked > 1 else ''} ({', '.join(report['trials'])}{of})"
    return f"{report['scenario']}: {units}; trained on {report['trained_on']}."


def _notes(report: dict[str, Any]) -> list[str]:
    """Return the notes below the tables."""
    observer = _OBSERVER if "observer" in report["topologies"] else ""
    return [note for note in (*report.get("own_faults", ()), observer, interval_note(report["rows"])) if note]


def ratios(report: dict[str, Any], intervals: bool = True) -> tuple[list[str], list[list[str]]]:
    """Return the head and the rows of ratios to hold, optionally with intervals.

    Estimators are against settings; of a grid or of many values, settings against estimators.
    """
    abouts = [about for about in report["settings"] if about["n_cells"]]
    settings = [about["setting"] for about in abouts]
    names = list(dict.fromkeys(row["estimator"] for row in report["rows"]))
    known = {(row["estimator"], row["setting"]): row for row in report["rows"]}
    rows = []
    if len(report["axes"]) > 1 or len(settings) > _MAX_COLUMNS:
        # A line has no room for so many points.
        for about in abouts:
            entries = [known.get((name, about["setting"])) for name in names]
            rows.append([*about["at"].values(), *(_ratio_or_none(entry, intervals) for entry in entries)])
        return [*map(_short_name, report["axes"]), *names], rows
    for name in names:
        entries = [known.get((name, setting)) for setting in settings]
        rows.append([name, *(_ratio_or_none(entry, intervals) for entry in entries)])
    return ["estimator", *("ratio to hold" if setting is None else str(setting) for setting in settings)], rows


def markdown(report: dict[str, Any]) -> str:
    """Return the comparison as Markdown tables, the same figures as in the terminal."""
    blocks = [headline(report), *(f"Warning: {text}." for text in report["warnings"] if text.startswith(IN_SAMPLE))]
    settings = [about for about in report["settings"] if about["n_cells"]]
    of_setting, turning = _by_setting(report["rows"]), _by_setting(report["orientation"])
    for about in settings:
        rows = [_wide_cells(row) for row in of_setting[about["setting"]]]
        blocks += [f"**{_title(about)}**", markdown_table((*_HEAD[:5], _NORMALIZED, *_HEAD[5:]), rows)]
        if about["setting"] in turning:
            blocks.append(markdown_table(TURN_HEAD, map(orientation_cells, turning[about["setting"]])))
    if len(settings) > 1:
        blocks += [f"**Ratio to hold, by `{report['sweep']}`**", markdown_table(*ratios(report))]
        if report["orientation"]:
            blocks.append(markdown_table(*orientation_ratios(report, degrees=False)))
    blocks.append(f"{_CAPTION}; {_NORMALIZED}: RMSE in units of the training rows' range. {TURN_CAPTION}.")
    blocks += _notes(report)
    return "\n\n".join(blocks) + "\n"


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table with a text column first and numbers after it."""
    lines = ["| " + " | ".join(head) + " |", "|---|" + "---:|" * (len(head) - 1)]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(lines)


def pooled_csv(report: dict[str, Any]) -> str:
    """Return one line for each setting and estimator; intervals as low and high."""
    return csv_text([_flat(row) for row in report["rows"]])


def orientation_csv(report: dict[str, Any]) -> str:
    """Return one line for each setting and orientation method; intervals as low and high."""
    return csv_text([_flat(row) for row in report["orientation"]])


def trials_csv(report: dict[str, Any]) -> str:
    """Return one line for each setting, trial and estimator."""
    return csv_text([_flat(row) for row in report["by_trial"]])


def _by_setting(rows: Rows) -> dict[str | None, list[dict[str, Any]]]:
    found: dict[str | None, list[dict[str, Any]]] = {}
    for row in rows:
        found.setdefault(row["setting"], []).append(row)
    return found


def _title(about: dict[str, Any]) -> str:
    values = ", ".join(f"{_short_name(path)} = {value}" for path, value in about.get("at", {}).items())
    at = f"{values}: " if values else ""
    age = about["age_ms"]
    return (
        f"{at}age median {number(age['p50'])} ms, p99 {number(age['p99'])} ms, "
        f"sent {number(about['packets_per_s'])} packets/s, {number(about['bytes_per_s'] / 1000)} kB/s"
    )


def _cells(row: dict[str, Any]) -> list[str]:
    interval = None if row["estimator"] == "hold" else row["ratio_to_hold_interval_95"]
    return [
        f"{row['estimator']} *" if row.get("faulty_steps") else row["estimator"],
        *(_percent(value) for value in row["r2_pct"]),
        _brief(row["rmse_3d_mm"]),
        _short(row["ratio_to_hold"], 3),
        "-" if interval is None else f"{_short(interval[0], 2)}-{_short(interval[1], 2)}",
        _fixed(row["coverage_pct"], 1),
        *(_brief(row["step_us"][name]) for name in ("p50", "p99")),
        _brief(row["train_s"]),
    ]


def _wide_cells(row: dict[str, Any]) -> list[str]:
    cells = _cells(row)
    return [*cells[:5], " ".join(_fixed(value, 3) for value in row["rmse_normalized"]), *cells[5:]]


def _short_name(path: str) -> str:
    return path.split(".")[-1]


def _ratio_or_none(row: dict[str, Any] | None, with_interval: bool) -> str:
    return "-" if row is None else _ratio(row, with_interval)


def _ratio(row: dict[str, Any], with_interval: bool) -> str:
    interval = row["ratio_to_hold_interval_95"] if with_interval and row["estimator"] != "hold" else None
    text = _short(row["ratio_to_hold"], 3)
    return text if interval is None else f"{text} ({_short(interval[0], 2)}-{_short(interval[1], 2)})"


def _short(value: float | None, digits: int) -> str:
    """Return a ratio with fewer digits where it is large, as of a filter that has diverged."""
    return _fixed(value, digits if value is None or value < 10 else 1 if value < 100 else 0)


def _brief(value: float | None) -> str:
    return _fixed(
        value, 2 if value is not None and abs(value) < 10 else 1 if value is not None and value < 100 else 0
    )


def _percent(value: float | None) -> str:
    return _fixed(value, 2 if value is None or value >= 99.5 else 1 if value > -100 else 0)


def _fixed(value: float | None, digits: int) -> str:
    if value is None:
        return "-"
    return f"{value:.{digits}f}" if abs(value) < 1e4 else f"{value:.0e}"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    table = Table(box=box.SIMPLE_HEAD)
    table.show_edge, table.padding = False, (0, 0, 0, 0)
    table.add_column(head[0], no_wrap=True)
    for name in head[1:]:
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    return table


def _flat(row: dict[str, Any]) -> dict[str, Any]:
    """Return a row with its lists and mappings spread over columns."""
    flat: dict[str, Any] = {}
    for name, value in row.items():
        if name in ("by_hand", "rmse_by_age_mm"):
            continue
        if name.endswith("_interval_95"):
            flat |= _bounds(name, value)
        elif isinstance(value, list):
            flat |= {f"{name}_{axis}": part for axis, part in zip("xyz", value, strict=True)}
        elif isinstance(value, dict):
            flat |= {f"{name}_{key}": part for key, part in value.items()}
        else:
            flat[name] = value
    return flat


def _bounds(name: str, value: Any) -> dict[str, Any]:
    per_axis = name.split("_interval")[0] in ("r2_pct", "rmse_mm", "rmse_normalized")
    axes = [f"_{axis}" for axis in "xyz"] if per_axis else [""]
    intervals = [None] * len(axes) if value is None else value if per_axis else [value]
    columns: dict[str, Any] = {}
    for axis, interval in zip(axes, intervals, strict=True):
        low, high = interval or (None, None)
        columns |= {f"{name}{axis}_low": low, f"{name}{axis}_high": high}
    return columns


def csv_text(rows: Rows) -> str:
    """Return rows with the same keys as CSV with a head; empty without rows."""
    if not rows:
        return ""
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return buffer.getvalue()
