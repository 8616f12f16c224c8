"""Tables of a comparison, and its forms that consist of them: for a terminal, as Markdown, CSV and LaTeX."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from math import inf
from typing import Any, Final

from rich.console import Group, RenderableType
from rich.text import Text

from tis.deploy.compare.results.answer import answer
from tis.deploy.compare.results.felt_and_seen import CAPTION as FELT_AND_SEEN
from tis.deploy.compare.results.felt_and_seen import felt_and_seen_table
from tis.deploy.compare.results.pooled import interval_note, origin
from tis.deploy.compare.results.report import is_starred, labels, star_note
from tis.deploy.present.notices import notices
from tis.deploy.present.numbers import NONE, broken_name, fixed, number
from tis.deploy.present.table import TIGHT, Column, Table
from tis.patient_side.provenance import IN_SAMPLE

Report = Mapping[str, Any]
Rows = Sequence[Mapping[str, Any]]

TURN_CAPTION: Final = (
    "deg: RMS of the angle between estimated and true orientation; gripper: RMS of its angle; each with its ratio to "
    "hold's and the per cent of the errors within the stated 95 % region"
)
SENT: Final = (
    "sent: packets of all keys, two for each hand: its command and its arm's position. hold and damped_velocity read "
    "the arm's alone; where packets are lost or overtake each other and the arm follows at once, part of what the "
    "others gain is the second packet's"
)
_CAPTION: Final = (
    "mm: RMSE in 3D; ratio: that over hold's, then its 95 % bootstrap interval over people; cover: per cent of the "
    "errors within the 95 % ellipsoid; \u00b5s: CPU time of a step, median and p99; train: s of its identification; "
    "age: over the scored ticks, how old the freshest sample is that has arrived, command or arm's position; "
    f"{SENT}"
)
_OBSERVER: Final = (
    "Topology observer: the commands pass clean, so the freshest sample is mostly a command; the arm's positions are "
    "as late as the network makes them."
)
_NAME_WIDTH: Final = 18
_MAX_COLUMNS: Final = 8
_MAX_SHOWN: Final = 12
_SHOWN_WARNINGS: Final = 5
"""Settings up to which a terminal shows a table each; of more it shows the ratios."""


def _short(value: float, digits: int = 2) -> str:
    """Return a number with fewer digits where it is large, as of a filter that has diverged."""
    return fixed(value, digits if value < 10 else 1 if value < 100 else 0)


def _percent(value: float) -> str:
    return fixed(value, 2 if value >= 99.5 else 1 if value > -100 else 0)


def _bounds(interval: Sequence[float]) -> str:
    return f"{_short(interval[0])}-{_short(interval[1])}"


def _with_digits(head: str, digits: int) -> Column:
    return Column(head, show=partial(fixed, digits=digits, below=inf))


# Scores of the estimators at one setting; they fit into 80 columns for every estimator.
_SCORES: Final = (
    Column("estimator", words=True),
    *(Column(head, show=_percent) for head in ("R\u00b2% x", "y", "z")),
    Column("mm", show=_short),
    Column("ratio", show=partial(_short, digits=3)),
    Column("95 %", show=_bounds),
    Column("cover", show=partial(fixed, digits=1)),
    *(Column(head, show=_short) for head in ("\u00b5s", "p99", "train")),
)
_NORMALIZED: Final = Column("x y z / range")


_WITHOUT_SCORE: Final[Mapping[str, Any]] = {
    "failed": True,
    **dict.fromkeys(("rmse_3d_mm", "ratio_to_hold", "ratio_to_hold_interval_95", "coverage_pct", "train_s")),
    **dict.fromkeys(("r2_pct", "rmse_normalized"), (None, None, None)),
    "step_us": {"p50": None, "p99": None},
}


def scores_table(rows: Rows, title: str = "") -> Table:
    """Return the scores of the estimators at one setting."""
    return Table(title, _SCORES, [_scores(row) for row in rows])


def _scores(row: Mapping[str, Any]) -> list[Any]:
    return [
        f"{row['estimator']}{' failed' if row.get('failed') else ' *' if is_starred(row) else ''}",
        *row["r2_pct"],
        row["rmse_3d_mm"],
        row["ratio_to_hold"],
        None if row["estimator"] == "hold" else row["ratio_to_hold_interval_95"],
        row["coverage_pct"],
        *(row["step_us"][name] for name in ("p50", "p99")),
        row["train_s"],
    ]


def _with_normalized(table: Table, rows: Rows) -> Table:
    """Return a table of scores with a column for the errors in units of the training rows' range."""
    texts = [" ".join(fixed(value, 3) for value in row["rmse_normalized"]) for row in rows]
    cells = [(*scores[:5], text, *scores[5:]) for scores, text in zip(table.rows, texts, strict=True)]
    return Table(table.title, (*_SCORES[:5], _NORMALIZED, *_SCORES[5:]), cells)


_TURNS: Final = (
    Column("orientation", words=True),
    _with_digits("deg", 2),
    _with_digits("ratio", 3),
    Column("95 %", show=lambda interval: f"{interval[0]:.2f}-{interval[1]:.2f}"),
    _with_digits("cover", 1),
    _with_digits("gripper rad", 4),
    _with_digits("ratio", 3),
    _with_digits("cover", 1),
    *(_with_digits(head, 1) for head in ("\u00b5s", "p99")),
)
_GRIPPER: Final = range(5, 8)
_TURN_SCORES: Final = ("coverage_pct", "gripper_rms_rad", "gripper_ratio_to_hold", "gripper_coverage_pct")


def turn_table(rows: Rows, title: str = "", settings: bool = False) -> Table:
    """Return the scores of the orientation methods: degrees beside hold's, the gripper likewise if one moves.

    With ``settings`` the setting of each row comes first.
    """
    opens = any(row["gripper_rms_rad"] is not None for row in rows)
    scores = _TURN_SCORES if opens else _TURN_SCORES[:1]
    columns = _TURNS if opens else tuple(one for k, one in enumerate(_TURNS) if k not in _GRIPPER)
    cells = [
        [
            row["method"],
            row["rms_deg"],
            row["ratio_to_hold"],
            None if row["method"] == "hold" else row["ratio_to_hold_interval_95"],
            *(row[name] for name in scores),
            *(row["step_us"][name] for name in ("p50", "p99")),
        ]
        for row in rows
    ]
    if settings:
        cells = [[str(row["setting"] or NONE), *cell] for row, cell in zip(rows, cells, strict=True)]
    return Table(title, ("setting", *columns) if settings else columns, cells)


def ratio_table(report: Report, intervals: bool = True) -> Table:
    """Return the ratios to hold, optionally with intervals.

    Estimators are against settings; of a grid or of many values, settings against estimators.
    """
    abouts = [about for about in report["settings"] if about["n_cells"]]
    known = {(row["estimator"], row["setting"]): _ratio(row, intervals) for row in report["rows"]}
    known |= {(name, about["setting"]): "failed" for about in abouts for name in about.get("failed", ())}
    names = list(dict.fromkeys(name for name, _ in known))
    heads = [labels(report).get(name, name) for name in names]
    if len(report["axes"]) > 1 or len(abouts) > _MAX_COLUMNS:
        # A line has no room for so many points.
        axes = [Column(_last(path), words=len(report["axes"]) > 1 or i == 0) for i, path in enumerate(report["axes"])]
        points = [
            (*about["at"].values(), *(known.get((name, about["setting"])) for name in names)) for about in abouts
        ]
        return Table("", [*axes, *heads], points)
    settings = [about["setting"] for about in abouts]
    columns = ["ratio to hold" if setting is None else str(setting) for setting in settings]
    rows = [[head, *(known.get((name, s)) for s in settings)] for head, name in zip(heads, names, strict=True)]
    return Table("", ["estimator", *columns], rows)


def table_by_setting(report: Report, title: str = "") -> Table | None:
    """Return error and ratio to hold, estimators against settings; None where a line has no room for these."""
    abouts = [about for about in report["settings"] if about["n_cells"]]
    if len(report["axes"]) != 1 or not 1 < len(abouts) <= _MAX_COLUMNS:
        return None
    known = {(row["estimator"], row["setting"]): f"{_short(row['rmse_3d_mm'])} ({_ratio(row, False)})"
             for row in report["rows"] if row["rmse_3d_mm"] is not None}  # fmt: skip
    known |= {(name, about["setting"]): "failed" for about in abouts for name in about.get("failed", ())}
    settings = [about["setting"] for about in abouts]
    names = dict.fromkeys(name for name, _ in known)
    label = labels(report)
    rows = [[label.get(name, name), *(known.get((name, setting)) for setting in settings)] for name in names]
    return Table(title, ["estimator", *map(str, settings)], rows, note=star_note(report))


def turn_ratio_table(report: Report, degrees: bool = True) -> Table:
    """Return the ratios to hold of the orientation methods, and ``degrees``: methods against settings."""
    settings = [about["setting"] for about in report["settings"] if about["n_cells"]]
    known = {(row["method"], row["setting"]): _turn(row, degrees) for row in report["orientation"]}
    names = dict.fromkeys(row["method"] for row in report["orientation"])
    head = "orientation, deg (ratio)" if degrees else "orientation"
    rows = [[name, *(known.get((name, setting)) for setting in settings)] for name in names]
    return Table("", [head, *map(str, settings)], rows)


def _ratio(row: Mapping[str, Any], with_interval: bool) -> str:
    value, interval = row["ratio_to_hold"], row["ratio_to_hold_interval_95"]
    text = NONE if value is None else _short(value, 3)
    return f"{text} ({_bounds(interval)})" if with_interval and interval and row["estimator"] != "hold" else text


def _turn(row: Mapping[str, Any], degrees: bool) -> str:
    ratio = fixed(row["ratio_to_hold"], 3, inf)
    return f"{fixed(row['rms_deg'], 2, inf)} ({ratio})" if degrees else ratio


def _tables(report: Report) -> list[tuple[Table, Rows, Table | None]]:
    """Return of each setting the table of its scores, the rows behind it, and that of its orientation methods."""
    found: list[tuple[Table, Rows, Table | None]] = []
    for about in report["settings"]:
        if about["n_cells"]:
            rows, turns = (
                [row for row in report[kind] if row["setting"] == about["setting"]]
                for kind in ("rows", "orientation")
            )
            rows += [{**_WITHOUT_SCORE, "estimator": name} for name in about.get("failed", ())]
            found.append((scores_table(rows, setting_title(about)), rows, turn_table(turns) if turns else None))
    return found


def tables_by_setting(report: Report) -> list[Table]:
    """Return the scores of each setting, a table each; of more settings than a terminal shows, the ratios to hold."""
    each = _tables(report)
    return [scores for scores, _, _ in each] if len(each) <= _MAX_SHOWN else [ratio_table(report)]


def setting_title(about: Mapping[str, Any]) -> str:
    """Return the values of a setting, how old its samples were, and what was sent."""
    values = ", ".join(f"{_last(path)} = {value}" for path, value in about.get("at", {}).items())
    at = f"{values}: " if values else ""
    age = about["age_ms"]
    return (
        f"{at}age median {number(age['p50'])} ms, p99 {number(age['p99'])} ms, "
        f"sent {number(about['packets_per_s'])} packets/s, {number(about['bytes_per_s'] / 1000)} kB/s"
    )


def _last(path: str) -> str:
    return path.split(".")[-1]


def headline(report: Report) -> str:
    """Return scenario, trials and training as a sentence."""
    n_trials, n_asked, seeds = len(report["trials"]), report["n_trials_asked"], report["n_seeds"]
    count = f"{n_trials}" if n_trials == n_asked else f"{n_trials} of {n_asked}"
    if report["source"] == "synthetic":
        units = f"{count} synthetic movements"
    else:
        of = f", {seeds} seeds each" if seeds > 1 else ""
        made = origin(report)
        what = f"synthetic trial{'s' * (n_asked > 1)}" if made == "synthetic" else f"trial{'s' * (n_asked > 1)}"
        units = f"{count} {what} ({', '.join(report['trials'])}{of})"
        units += f", {', '.join(report['synthetic'])} synthetic" if made.startswith("partly") else ""
    return f"{report['scenario']}: {units}; trained on {report['trained_on']}."


def warnings(report: Report) -> list[str]:
    """Return the lines of the warnings for terminal and page."""
    return notices(report["warnings"], _SHOWN_WARNINGS, "table.json")


def _turn_captions(report: Report) -> list[str]:
    return [TURN_CAPTION] if report["orientation"] else []


def _notes(report: Report) -> list[str]:
    """Return the notes below the tables."""
    observer = _OBSERVER if "observer" in report["topologies"] else ""
    network = "; ".join(report.get("network", ()))
    network = f"Network: {network}." if network else ""
    notes = (network, *report.get("own_faults", ()), observer, interval_note(report["rows"]))
    return [note for note in notes if note]


def view(report: Report) -> RenderableType:
    """Return the comparison for a terminal: a table per setting and, with a sweep, a table of ratios."""
    parts: list[RenderableType] = [Text(headline(report), style="bold"), Text(answer(report))]
    each = _tables(report)
    for scores, _, turns in each if len(each) <= _MAX_SHOWN else ():
        narrow = [[broken_name(str(name), _NAME_WIDTH), *values] for name, *values in scores.rows]
        parts += [Text(f"\n{scores.title}"), replace(scores, title="", rows=narrow).terminal(TIGHT)]
        parts += [] if turns is None else [turns.terminal(TIGHT)]
    many = f"table.md has a table of each of {len(each)} settings."
    caption = ". ".join([_CAPTION, *_turn_captions(report)]) if len(each) <= _MAX_SHOWN else many
    parts += [Text(f"\n{note}", style="dim") for note in (caption, *_notes(report))]
    if len(each) > 1:
        ratios = ratio_table(report, intervals=False)
        parts += [Text(f"\nRatio to hold, by {report['sweep']}"), ratios.terminal(TIGHT)]
        if report["orientation"] and len(each) <= _MAX_COLUMNS:
            parts.append(turn_ratio_table(report, degrees=False).terminal(TIGHT))
    if report["touch_and_sight"]:
        parts += [Text("\nTouch and sight"), felt_and_seen_table(report["touch_and_sight"]).terminal(TIGHT)]
        parts.append(Text(f"\n{FELT_AND_SEEN}", style="dim"))
    return Group(*parts)


def markdown(report: Report) -> str:
    """Return the comparison as Markdown tables, the same figures as in the terminal."""
    blocks = [
        f"{headline(report)} {answer(report)}".strip(),
        *(f"Warning: {text}." for text in report["warnings"] if text.startswith(IN_SAMPLE)),
    ]
    each = _tables(report)
    for scores, rows, turns in each:
        blocks += [_with_normalized(scores, rows).markdown(), *([] if turns is None else [turns.markdown()])]
    if len(each) > 1:
        blocks += [f"**Ratio to hold, by `{report['sweep']}`**", ratio_table(report).markdown()]
        blocks += [turn_ratio_table(report, degrees=False).markdown()] if report["orientation"] else []
    if report["touch_and_sight"]:
        blocks += [felt_and_seen_table(report["touch_and_sight"], "Touch and sight").markdown(), f"{FELT_AND_SEEN}."]
    normalized = f"{_CAPTION}; {_NORMALIZED.head}: RMSE in units of the training rows' range"
    blocks.append(". ".join([normalized, *_turn_captions(report)]) + ".")
    return "\n\n".join([*blocks, *_notes(report), *report.get("failed", ())]) + "\n"


def latex(report: Report) -> str:
    """Return a ``tabular`` of the ratios to hold, the command in a comment above it."""
    # A command that is longer than a line stays a comment.
    command = " ".join(report["command"].split())
    made = [f"{origin(report)} movement"] if origin(report) else []
    made += [*report.get("own_faults", ()), *report.get("failed", ())]
    return ratio_table(report).latex(
        command, "RMSE in 3D over that of hold, with 95 % bootstrap intervals over people", *made
    )


_PER_AXIS: Final = ("r2_pct_interval_95", "rmse_mm_interval_95", "rmse_normalized_interval_95")


def csv(rows: Rows) -> str:
    """Return one line for each row of a report: lists and mappings spread over columns, intervals as low and high."""
    return Table.of_records([_flat(row) for row in rows]).csv()


def _flat(row: Mapping[str, Any]) -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in row.items():
        if name in ("by_hand", "rmse_by_age_mm"):
            continue
        if name in _PER_AXIS:
            for axis, bounds in zip("xyz", value or [None] * 3, strict=True):
                flat |= _low_and_high(f"{name}_{axis}", bounds)
        elif name.endswith("_interval_95"):
            flat |= _low_and_high(name, value)
        elif isinstance(value, list):
            flat |= {f"{name}_{axis}": part for axis, part in zip("xyz", value, strict=True)}
        elif isinstance(value, dict):
            flat |= {f"{name}_{key}": part for key, part in value.items()}
        else:
            flat[name] = value
    return flat


def _low_and_high(name: str, bounds: Sequence[float] | None) -> dict[str, float | None]:
    low, high = bounds or (None, None)
    return {f"{name}_low": low, f"{name}_high": high}
