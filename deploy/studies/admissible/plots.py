"""Figure of the regions (border, judged networks, profiles), and the page that shows it."""

import base64
from collections.abc import Mapping
from html import escape
from typing import Any, Final

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tis.deploy.compare.grid import axis_words
from tis.deploy.compare.results.figures import tone
from tis.deploy.present.page import Page, Section, nonbreaking_units, note, page_html, problem_list
from tis.deploy.report.publication.matplotlib_figures import STYLE
from tis.deploy.studies.admissible import tables
from tis.deploy.studies.admissible.criterion import Limit
from tis.deploy.studies.admissible.tables import people_words

_INK: Final = "#222222"
_MAX_COLUMNS: Final = 3
_MAX_LABELLED: Final = 14
_LABELS_FROM: Final = 0.62
_LABEL_STEP: Final = 0.06
"""Column of names, as shares of the panel."""


def region_figure(report: dict[str, Any]) -> Figure | None:
    """Return the regions in the plane, or as bars on a single axis; None for three axes or more."""
    if len(report["axes"]) > 2:
        return None
    with mpl.rc_context(STYLE):
        return _bars(report) if len(report["axes"]) == 1 else _plane(report)


def _plane(report: dict[str, Any]) -> Figure:
    names = list(report["estimators"])
    n_columns = 1 if len(names) == 1 else 2 if len(names) <= 4 else _MAX_COLUMNS
    n_rows = -(-len(names) // n_columns)
    figure = Figure(figsize=(0.4 + 3.9 * n_columns, 0.9 + 3.2 * n_rows), layout="constrained")
    panels = figure.subplots(n_rows, n_columns, squeeze=False, sharex=True, sharey=True).ravel()
    for panel in panels[len(names) :]:
        panel.set_visible(False)
    for axes, name in zip(panels, names, strict=False):
        _panel(axes, report, name, tone(name, names))
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 5))
    limits = " and ".join(Limit(**limit).text for limit in report["limits"])
    figure.suptitle(f"Networks with {limits}, 95 % confidence over {people_words(report)}", fontsize=9)
    return figure


def _panel(axes: Axes, report: dict[str, Any], name: str, colour: str) -> None:
    across, up = report["axes"]
    about = report["estimators"][name]
    outline = [(values[across["path"]], values[up["path"]]) for values in about["outline"]]
    if outline:
        axes.fill(*zip(*outline, strict=True), color=colour, alpha=0.22, linewidth=0, label="admissible")
        border = list(zip(*outline[:-1], strict=True))
        axes.plot(*border, color=colour, linewidth=1.4, marker=".", markersize=3, label="border")
    for inside, label, face in ((True, "judged admissible", colour), (False, "judged not admissible", "none")):
        points = [
            (point["at"][across["path"]], point["at"][up["path"]])
            for point in report["points"]
            if point["verdicts"][name]["inside"] is inside
        ]
        if points:
            x, y = zip(*points, strict=True)
            axes.scatter(x, y, s=7, facecolors=face, edgecolors=colour, linewidths=0.5, label=label, zorder=2)
    _place_profiles(axes, report, name)
    setters = ((across, axes.set_xscale, axes.set_xlim), (up, axes.set_yscale, axes.set_ylim))
    for axis, set_scale, set_limit in setters:
        set_scale("log" if axis["log"] else "linear")
        margin = 0.0 if axis["log"] else 0.02 * (axis["last"] - axis["first"])
        set_limit(axis["first"] - margin, axis["last"] + margin)
    axes.set_xlabel(axis_words(across["path"]))
    axes.set_ylabel(axis_words(up["path"]))
    axes.label_outer()
    axes.set_title(f"{name}: {100 * about['share']:.1f} % of the box", loc="left")


def _place_profiles(axes: Axes, report: dict[str, Any], name: str) -> None:
    """Draw the profiles that lie in the box, each with its own verdict, and name them while there are few."""
    across, up = report["axes"]
    placed = [one for one in report["profiles"] if one["at"] is not None and _lies_in(one["at"], (across, up))]
    for inside, meaning, face in ((True, "profile, admissible", _INK), (False, "profile, not admissible", "white")):
        found = [one["at"] for one in placed if one["verdicts"][name]["inside"] is inside]
        if found:
            x, y = ([at[axis["path"]] for at in found] for axis in (across, up))
            look: dict[str, Any] = {"facecolors": face, "edgecolors": _INK, "linewidths": 0.8, "zorder": 4}
            axes.scatter(x, y, s=26, marker="D", label=meaning, **look)
    if len(placed) <= _MAX_LABELLED:
        _name(axes, {one["name"]: (one["at"][across["path"]], one["at"][up["path"]]) for one in placed})


def _name(axes: Axes, places: dict[str, tuple[float, float]]) -> None:
    """Write the names of places in a column at the right, each with a line to its place."""
    for i, (name, at) in enumerate(sorted(places.items(), key=lambda item: (-item[1][1], item[1][0]))):
        axes.annotate(
            name,
            at,
            xytext=(_LABELS_FROM, 0.9 - _LABEL_STEP * i),
            textcoords="axes fraction",
            fontsize=6,
            color=_INK,
            va="center",
            zorder=5,
            arrowprops={"arrowstyle": "-", "linewidth": 0.4, "color": "#999999", "shrinkA": 1, "shrinkB": 3},
            bbox={"boxstyle": "square,pad=0.1", "facecolor": "white", "linewidth": 0, "alpha": 0.8},
        )


def _lies_in(at: dict[str, float], axes: tuple[dict[str, Any], ...]) -> bool:
    return all(axis["first"] <= at[axis["path"]] <= axis["last"] for axis in axes)


def _bars(report: dict[str, Any]) -> Figure:
    """Return the interval of each estimator on a single axis."""
    (axis,) = report["axes"]
    names = list(report["estimators"])
    figure = Figure(figsize=(5.5, 1.0 + 0.45 * len(names)), layout="constrained")
    axes = figure.subplots()
    for i, name in enumerate(names):
        colour = tone(name, names)
        outside = [p["at"][axis["path"]] for p in report["points"] if not p["verdicts"][name]["inside"]]
        inside = [p["at"][axis["path"]] for p in report["points"] if p["verdicts"][name]["inside"]]
        border = [values[axis["path"]] for values in report["estimators"][name]["border"]]
        if border:
            begin = report["estimators"][name]["start"][axis["path"]]
            axes.barh(i, border[0] - begin, left=begin, height=0.5, color=colour, alpha=0.3)
        axes.scatter(inside, [i] * len(inside), s=9, color=colour)
        axes.scatter(outside, [i] * len(outside), s=9, facecolors="none", edgecolors=colour, linewidths=0.6)
    axes.set_xscale("log" if axis["log"] else "linear")
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set_xlabel(axis_words(axis["path"]))
    limits = " and ".join(Limit(**limit).text for limit in report["limits"])
    axes.set_title(f"{limits}, 95 % confidence over {people_words(report)}", loc="left")
    return figure


# ``admissible.html``: which networks each estimator admits, on one page without a server.

Report = Mapping[str, Any]


def admissible_html(report: Report, svg: str | bytes | None) -> str:
    """Return the page; ``svg`` is the figure of the regions, None without one."""
    words = f'<p class="answer">{escape(nonbreaking_units(tables.answer(report)))}</p>'
    words += problem_list((), tables.warnings(report))
    sections = [Section("answer", "The answer", markup=words)]
    if svg is not None:
        data = base64.b64encode(svg.encode() if isinstance(svg, str) else svg).decode()
        alt = "The admissible region of each estimator"
        image = f'<img class="regions" alt="{alt}" src="data:image/svg+xml;base64,{data}">'
        sections.append(Section("regions", "Regions", markup=image))
    caption = tables.caption(report)
    found = tables.regions(report).html() + note(f"{caption[0].upper()}{caption[1:]}.")
    sections.append(Section("shares", "Regions in numbers", markup=found))
    if report["profiles"]:
        profiles = tables.profiles(report).html() + note(f"{tables.profiles_note(report)}.")
        sections.append(Section("profiles", "Profiles of the library", markup=profiles))
    command = f"<pre><code>{escape(report['command'])}</code></pre>"
    sections.append(Section("repeat", "How to repeat it", markup=command))
    title = f"{report['scenario']}: admissible networks"
    tags = [(f"{report['n_points']:,} networks", ""), (f"{report['n_twins']:,} twins", "")]
    if report["synthetic"]:
        tags.append(("synthetic movement", "open"))
    style = ".regions { display: block; width: 100%; max-width: 900px; background: white; border-radius: 6px; }"
    return page_html(Page(title, title, tags, sections, tables.headline(report)), more_style=style)
