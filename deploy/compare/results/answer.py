"""The answer of a comparison in words: the best estimator of each setting, and the rivals not told apart from it."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from tis.deploy.compare.results.pooled import ENOUGH_PEOPLE
from tis.deploy.present.numbers import number

Report = Mapping[str, Any]
Rows = Sequence[Mapping[str, Any]]

_LEAST_COVER_PCT: Final = 80.0
"""Cover below which an estimator's covariance misleads whoever relies on it."""
_MAX_NAMED: Final = 3
"""Settings that are named one by one; of more their number is told."""


def answer(report: Report) -> str:
    """Return the estimator that is best at each setting, its gain over hold, and the rivals not told apart from it.

    Best is the smallest 3D RMSE. A rival is told apart if the 95 % interval of its RMSE over the best one's, over
    people, lies above 1 (`tis.deploy.compare.results.pooled.rivalries`); of fewer than `ENOUGH_PEOPLE` none is, as
    their intervals cover less. "" without a scored row. Oracle: literal reports, test_answer.
    """
    names = {
        about["setting"]: ", ".join(f"{path.split('.')[-1]} = {value}" for path, value in about.get("at", {}).items())
        for about in report["settings"]
    }
    ranked = [rows for setting in names if (rows := ranking(report["rows"], setting))]
    if not ranked:
        return ""
    won: dict[str, list[Rows]] = {}
    for rows in ranked:
        won.setdefault(rows[0]["estimator"], []).append(rows)
    each = sorted(won.items(), key=lambda item: -len(item[1]))
    sentences = [
        _won(name, own, _where([names[rows[0]["setting"]] for rows in own], len(ranked))) for name, own in each
    ]
    return " ".join([*sentences, *_close(ranked, names, len(report["trials"])), *_overconfident(report, len(ranked))])


def ranking(rows: Rows, setting: str | None) -> Rows:
    """Return the scored rows of a setting, the smallest error first."""
    own = [row for row in rows if row["setting"] == setting and row["rmse_3d_mm"] is not None]
    return sorted(own, key=lambda row: float(row["rmse_3d_mm"]))


def _won(name: str, settings: Sequence[Rows], where: str) -> str:
    if name == "hold":
        return f"No estimator is better than hold{where}."
    gains = [100 * (1 - ratio) for rows in settings if (ratio := rows[0]["ratio_to_hold"]) is not None]
    if not gains:
        return f"{name} is best{where}."
    low, high = _gain(min(gains)), _gain(max(gains))
    span = f"{low} %" if low == high else f"{low} to {high} %"
    return f"{name} is best{where}: its error is {span} below hold's."


def _gain(pct: float) -> str:
    """Return a gain in per cent; from 99 on with what is left of the error: no gain is 100 %."""
    return f"{pct:.0f}" if pct < 99 else f"{100 - float(f'{100 - pct:.1g}'):.6g}"


def _close(ranked: Sequence[Rows], names: Mapping[str | None, str], n_trials: int) -> Iterable[str]:
    """Yield which rivals are not told apart from the best, by rival, or that the people are too few to tell."""
    n_people = ranked[0][0]["n_people"]
    if n_people < 2:
        # Not only people make recordings: a rover and a drone do, too.
        these = "this recording" if n_trials == 1 else "these recordings"
        yield f"This holds for {these} alone: nothing can be claimed about others."
        return
    if n_people < ENOUGH_PEOPLE:
        yield f"With {n_people} people no estimator is told apart from another: that takes {ENOUGH_PEOPLE}."
        return
    near: dict[tuple[str, str], list[str]] = {}
    for best, *others in ranked:
        for row in others:
            interval = row["ratio_to_best_interval_95"]
            if interval is None or interval[0] <= 1.0:
                near.setdefault((best["estimator"], row["estimator"]), []).append(names[row["setting"]])
    if not near:
        yield "It is told apart from each other one." if len(ranked) == 1 else "Each is told apart from all others."
    for (best_name, rival), settings in near.items():
        yield f"{rival} is not told apart from {best_name}{_where(settings, len(ranked))}."


def _overconfident(report: Report, n_settings: int) -> Iterable[str]:
    """Yield a sentence for each estimator, of positions or orientations, whose 95 % regions hold far fewer errors."""
    least: dict[tuple[str, str], float] = {}
    kinds = (
        ("rows", "estimator", "coverage_pct", "95 % ellipsoids hold {} % of its errors"),
        ("orientation", "method", "coverage_pct", "95 % regions hold {} % of its errors of orientation"),
        ("orientation", "method", "gripper_coverage_pct", "95 % intervals hold {} % of its errors of the gripper"),
    )
    for table, who, column, words in kinds:
        for row in report.get(table, ()):
            cover = row.get(column)
            if cover is not None and cover < _LEAST_COVER_PCT:
                least[row[who], words] = min(cover, least.get((row[who], words), cover))
    for (name, words), cover in least.items():
        yield (
            f"{name} is overconfident: its {words.format(number(cover))}"
            f"{' at the worst setting' if n_settings > 1 else ''}."
        )


def _where(settings: Sequence[str], n_all: int) -> str:
    """Return the settings in words: each, a few by name, or their number."""
    if n_all == 1:
        return ""
    if len(settings) == n_all:
        return f" at each of the {n_all} settings"
    if len(settings) <= _MAX_NAMED:
        return f" at {'; at '.join(settings)}"
    return f" at {number(len(settings))} of {n_all} settings"
