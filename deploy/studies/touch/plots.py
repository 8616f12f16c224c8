"""Figure of the stability regions: stiffness over delay, a line for each loop, beside theory's curve."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import matplotlib as mpl
from matplotlib.figure import Figure

from tis.deploy.present.palette import SERIES
from tis.deploy.report.publication.matplotlib_figures import STYLE

_INK: Final = "#222222"
_MARKS: Final = "osD^vPX*"


def touch_figure(report: Mapping[str, Any]) -> Figure:
    """Return the figure: below its line a loop was stable; a triangle stands for a wall stiffer than any tried."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.2, 4.2), layout="constrained")
        axes = figure.subplots()
        for i, (name, rows) in enumerate(_by_loop(report["borders"]).items()):
            colour, mark = SERIES[i % len(SERIES)].light, _MARKS[i % len(_MARKS)]
            known = [(row["delay_ms"], row["stable_n_m"]) for row in rows if row["stable_n_m"] is not None]
            if known:
                axes.plot(
                    *zip(*known, strict=True), color=colour, marker=mark, markersize=4, linewidth=1.4, label=name
                )
            open_ = [(row["delay_ms"], row["stable_n_m"]) for row in rows if row["not_stable_n_m"] is None]
            if open_:
                x, y = zip(*open_, strict=True)
                axes.scatter(x, y, s=70, marker="^", facecolors="none", edgecolors=colour)
        theory = [(row["delay_ms"], row["limit_n_m"]) for row in report["borders"] if row["limit_n_m"] is not None]
        if theory:
            line = sorted(dict(theory).items())
            axes.plot(
                *zip(*line, strict=True), color=_INK, linestyle="--", linewidth=1.2, label="theory, newest sample"
            )
        axes.set_yscale("log")
        soft, hard = report["walls_n_m"]
        axes.set_ylim(soft / 1.2, hard * 1.5)
        axes.set_xlabel("delay of each way, ms")
        axes.set_ylabel("stiffness of the wall, N/m")
        axes.set_title("Stable below the line; open triangle: also the stiffest wall tried", loc="left")
        figure.legend(loc="outside lower center", ncols=3)
    return figure


def _by_loop(rows: Sequence[Mapping[str, Any]]) -> dict[str, list[Mapping[str, Any]]]:
    found: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        found.setdefault(row["loop"], []).append(row)
    return found
