"""``comparison.html``: filters, curves, map, error against age and table on one page, without a server."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from html import escape
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from bokeh.models import ColumnDataSource, FixedTicker, HoverTool, LinearColorMapper
from bokeh.models.annotations import ColorBar, Span
from bokeh.models.ranges import Range1d
from bokeh.plotting import figure

from tis.deploy.compare.grid import axis_words
from tis.deploy.compare.results.answer import answer
from tis.deploy.compare.results.felt_and_seen import CAPTION as FELT_AND_SEEN
from tis.deploy.compare.results.felt_and_seen import felt_and_seen_table
from tis.deploy.compare.results.page_sums import PageSums
from tis.deploy.compare.results.pooled import origin
from tis.deploy.compare.results.report import labels, star_note
from tis.deploy.compare.results.tables import (
    SENT,
    TURN_CAPTION,
    headline,
    setting_title,
    table_by_setting,
    tables_by_setting,
    turn_table,
    warnings,
)
from tis.deploy.present.page import Page, Section, folded, nonbreaking_units, note, page_html, problem_list
from tis.deploy.present.palette import AXIS, SOFT, look_of
from tis.deploy.present.plot_style import Figure, Key, LineStyle, line_keys, plain_figure

# Empty figures of a comparison's page, whose sources the page's script fills.

CURVES: Final = {"ratio": "3D RMSE over hold's", "rmse": "3D RMSE, mm"}
_SOURCE: Final = ("x", "y", "low", "high", "at", "band", "ticks", "people", "estimator")
_TOOLTIPS: Final = [
    ("ticks", "@ticks{0,0}"),
    ("people", "@people"),
]
_BAND_ALPHA: Final = 0.14
_LARGEST_RATIO: Final = 1.2


def curve_figures(names: Sequence[str], named: Mapping[str, str]) -> Figure:
    """Return ratio and RMSE against an axis, a line with a band for each estimator."""
    plots = tuple(_lines(name, label, names, with_bands=True) for name, label in CURVES.items())
    caption = "Pooled over all that is chosen above; the axis is chosen here. The bands are over people."
    return Figure(
        plots, "Errors along an axis", caption, "Error of each estimator against the chosen axis", _keys(names, named)
    )


def age_figure(names: Sequence[str], named: Mapping[str, str]) -> Figure:
    """Return the 3D error against the age of the freshest sample."""
    plot = _lines("age", "3D RMSE, mm", names, with_bands=False)
    plot.xaxis.axis_label = "age of the freshest sample, ms"
    caption = "Age: how old the freshest sample is that has arrived by the tick. The ticks between two marks are one "
    caption += "point, at their mean age."
    return Figure((plot,), "Error against age", caption, "Error of each estimator against age", _keys(names, named))


def _keys(names: Sequence[str], named: Mapping[str, str]) -> tuple[Key, ...]:
    """Return the legend of a figure's lines; what is shown is chosen above."""
    return tuple(
        replace(key, name=named.get(key.name, key.name), toggles=False)
        for key in line_keys({name: LineStyle(look_of(name, names), 1.8, shown=True) for name in names})
    )


def heat_figure() -> Figure:
    """Return the ratio over two axes as a map."""
    columns = ("x", "y", "ratio", "text", "ink", "across", "up", "rmse", "ticks", "people")
    source = ColumnDataSource({name: [] for name in columns}, name="heat")
    plot = plain_figure(380, **_ranges(), name="heat-figure")
    mapper = LinearColorMapper(palette="Viridis256", low=0, high=_LARGEST_RATIO, nan_color="#00000000")
    colour: Any = {"field": "ratio", "transform": mapper}
    drawn = plot.rect("x", "y", 1, 1, source=source, fill_color=colour, line_color=None)
    plot.text(
        "x", "y", "text", source=source, text_color="ink", text_align="center", text_baseline="middle",
        text_font_size="12px",
    )  # fmt: skip
    tips = [("", "@up, @across"), ("ratio", "@ratio{0.000}"), ("3D RMSE, mm", "@rmse{0.000}")]
    plot.add_tools(HoverTool(renderers=[drawn], tooltips=[*tips, ("ticks", "@ticks{0,0}"), ("people", "@people")]))
    bar = ColorBar(color_mapper=mapper, width=12, background_fill_color=None, major_label_text_color=SOFT.light)
    plot.add_layout(bar, "right")
    plot.grid.visible = False
    _fixed(plot)
    caption = "3D RMSE of one estimator over hold's, pooled over all else that is chosen above."
    return Figure((plot,), "Two axes", caption, "Map of the ratio over two axes")


def _lines(name: str, label: str, names: Sequence[str], with_bands: bool) -> figure:
    """Return a figure with a line for each estimator, its source named ``NAME:ESTIMATOR``."""
    plot = plain_figure(320, **_ranges(), y_axis_label=label, name=f"{name}-figure")
    if name == "ratio":
        plot.add_layout(Span(location=1, dimension="width", line_color=AXIS.light, line_dash="dotted"))
    tips = [("", "@estimator"), ("at", "@at"), ("ratio" if name == "ratio" else label, "@y{0.000} @band")]
    for estimator in names:
        look = look_of(estimator, names)
        source = ColumnDataSource({column: [] for column in _SOURCE}, name=f"{name}:{estimator}")
        if with_bands:
            plot.varea("x", "low", "high", source=source, fill_color=look.tone.light, fill_alpha=_BAND_ALPHA)
            plot.segment(
                "x", "low", "x", "high", source=source, line_color=look.tone.light, line_width=3, line_alpha=0.6
            )
        dash: Any = look.dash
        plot.line("x", "y", source=source, line_width=1.8, line_color=look.tone.light, line_dash=dash)
        dots = plot.scatter("x", "y", source=source, size=7, color=look.tone.light)
        plot.add_tools(HoverTool(renderers=[dots], tooltips=[*tips, *_TOOLTIPS], visible=False))
    _fixed(plot)
    return plot


def _ranges() -> dict[str, Range1d]:
    """Return ranges of which the script sets the ends."""
    return {"x_range": Range1d(start=0, end=1), "y_range": Range1d(start=0, end=1)}


def _fixed(plot: figure) -> None:
    """Let the script place the ticks: at the values of an axis, at the edges of bins."""
    for axis in (plot.xaxis[0], plot.yaxis[0]) if plot.name == "heat-figure" else (plot.xaxis[0],):
        axis.ticker = FixedTicker(ticks=[])


_SCRIPTS: Final = tuple(Path(__file__).with_name(name) for name in ("pooling.js", "comparison.js"))
_STYLE: Final = Path(__file__).with_name("comparison.css")
_COLUMNS: Final = ("estimator", "R\u00b2 x, %", "y", "z", "3D RMSE, mm", "95 %", "ratio to hold", "95 %", "cover, %")
_COUNTS: Final = ("ticks", "people")
_POOLED: Final = '<p class="pooled"></p>'
"""Where the script tells which values the figures pool."""
_WHATEVER: Final = "All people and hands, whatever is chosen above."
_PLAIN: Final[Mapping[str, str]] = MappingProxyType({})
"""Labels of names that are shown as they are."""
_MARKS: Final = {"solid": "", "dashed": "dashed", "dotted": "dotted", "dashdot": "dashdot"}


def comparison_html(report: dict[str, Any], sums: PageSums) -> str:
    """Return the page; the script pools `sums` again whenever a filter changes."""
    found = f'<p class="answer">{escape(nonbreaking_units(answer(report)))}</p>'
    computed = [one for one in report["settings"] if one["n_cells"]]
    found += note(f"{setting_title(computed[0])} ({SENT}).") if len(computed) == 1 else ""
    found += note("Network: " + "; ".join(report["network"]) + ".") if report.get("network") else ""
    found += problem_list([*report["own_faults"], *report["failed"], *report["unscored"]], warnings(report))
    named = _named(report)
    filters = _filters(sums, named)
    sections = [
        Section("answer", "The answer", markup=found),
        Section("choose", "What is shown", markup=f'{filters}{_POOLED}<p class="note" id="words"></p>'),
    ]
    if sums.axes:
        choice = _select("x-axis", "Axis", list(sums.axes))
        sections.append(Section("curves", "Curves", [curve_figures(sums.estimators, named)], before=choice))
    if len(sums.axes) > 1 and not report["zipped"]:
        paths = list(sums.axes)
        choice = _select("across", "Across", paths, 1) + _select("up", "Up", paths)
        others = [name for name in sums.estimators if name != "hold"] or list(sums.estimators)
        choice += _select("of", "Estimator", others)
        sections.append(Section("map", "Map", [heat_figure()], before=f'<div class="choices">{choice}</div>'))
    sections.append(Section("age", "Age", [age_figure(sums.estimators, named)]))
    sections.append(Section("table", "Table", markup=_tables(report)))
    if report["orientation"]:
        turns = turn_table(report["orientation"], "Orientation and gripper", settings=True).html()
        found = turns + note(f"{TURN_CAPTION}. {_WHATEVER}")
        sections.append(Section("orientation", "Orientation", markup=found))
    if report["touch_and_sight"]:
        felt = felt_and_seen_table(report["touch_and_sight"], "Touch and sight").html()
        sections.append(Section("felt", "Touch and sight", markup=felt + note(f"{FELT_AND_SEEN}. {_WHATEVER}")))
    command = f"<pre><code>{escape(report['command'])}</code></pre>"
    sections.append(Section("repeat", "How to repeat it", markup=command))
    shown = [named.get(name, name) for name in sums.estimators]
    more = {"synthetic": report["source"] == "synthetic", "labels": shown}
    about = json.dumps(sums.about() | more, allow_nan=False)
    about = about.replace("<", "\\u003c")  # no text may end the element that holds it
    data = f'<script type="application/json" id="about">{about}</script>'
    data += f'<script type="text/plain" id="sums">{sums.packed()}</script>'
    scripts = "".join(script.read_text(encoding="utf-8") for script in _SCRIPTS)
    title = f"{report['scenario']}: estimators compared"
    made = origin(report)
    kind = "" if made == "synthetic" else report["source"]  # the file format of JIGSAWS is no origin
    tags = [
        (f"{report['n_computed']:,} twin{'s' * (report['n_computed'] != 1)}", ""),
        (f"{made} movement" if made else "", "open"),
        (kind, ""),
    ]
    tags = [(text, look) for text, look in tags if text]
    return page_html(
        Page(title, title, tags, sections, headline(report)),
        more_style=_STYLE.read_text(encoding="utf-8"),
        more_script=f"{data}<script>{scripts}</script>",
    )


def _named(report: dict[str, Any]) -> dict[str, str]:
    """Return the estimators' names as they are shown: one that has no score at any setting as failed."""
    failed = {name: f"{name} failed" for about in report["settings"] for name in about.get("failed", ())}
    return failed | labels(report)


def _filters(sums: PageSums, named: Mapping[str, str]) -> str:
    parts = [_chips("estimators", "Estimators", sums.estimators, named, marks=True)]
    if len(sums.people) > 1:
        parts.append(_chips("people", "People", sums.people))
    if len(sums.hands) > 1:
        parts.append(_chips("hands", "Hands", sums.hands))
    parts += [
        f'<label class="axis" title="{escape(path)}"><span>{escape(axis_words(path))}</span>'
        f'<input type="range" min="0" max="{len(values)}" value="0" step="1" data-axis="{i}">'
        f"<output>all</output></label>"
        for i, (path, values) in enumerate(sums.axes.items())
        if len(values) > 1
    ]
    return f'<div class="filters">{"".join(parts)}</div>'


def _chips(
    kind: str, title: str, names: Sequence[str], named: Mapping[str, str] = _PLAIN, marks: bool = False
) -> str:
    """Return buttons, one for each name, that choose it or leave it out; and two for all and none."""
    chips = "".join(
        f'<li><button type="button" data-chip="{kind}" data-place="{i}" aria-pressed="true">'
        f"{_mark(name, names) if marks else ''}{escape(named.get(name, name))}</button></li>"
        for i, name in enumerate(names)
    )
    both = "".join(
        f'<button type="button" class="every" data-every="{kind}" data-to="{to}">{text}</button>'
        for to, text in (("true", "all"), ("false", "none"))
    )
    both = both if len(names) > 2 else ""
    return f'<div class="chips"><span>{title}{both}</span><ul class="keys">{chips}</ul></div>'


def _mark(name: str, names: Sequence[str]) -> str:
    look = look_of(name, names)
    return f'<i class="{_MARKS[look.dash]}" style="color:light-dark({look.tone.light},{look.tone.dark})"></i>'


def _select(name: str, title: str, options: Sequence[str], chosen: int = 0) -> str:
    words = [axis_words(text) if "." in text else text for text in options]  # estimators are no fields
    each = "".join(
        f'<option value="{escape(text)}"{" selected" * (i == chosen)}>{escape(shown)}</option>'
        for i, (text, shown) in enumerate(zip(options, words, strict=True))
    )
    return f'<label class="choice">{title} <select id="{name}">{each}</select></label>'


def _tables(report: dict[str, Any]) -> str:
    """Return the table by setting, and below it, folded, the one that pools what is chosen; that alone without."""
    axis = "".join(axis_words(path) for path in report["axes"][:1])
    found = table_by_setting(report, f"3D RMSE in mm (over hold's), by {axis}")
    if found is None:
        return _table(report)
    found = replace(found, note=". ".join(filter(None, [star_note(report), _WHATEVER])))
    return f'<div class="wide">{found.html()}</div>' + folded("Pooled over what is chosen above", _table(report))


def _table(report: dict[str, Any]) -> str:
    """Return the table that the script fills; a browser without scripts shows the scores by setting in its place."""
    head = "".join(f'<th scope="col">{text}</th>' for text in (*_COLUMNS, *_COUNTS))
    note = (
        "Pooled over all that is chosen, every tick with the same weight. Ratio: 3D RMSE over that of hold on the "
        "same ticks. Cover: share of the errors within the 95 % ellipsoid. 95 %: bootstrap interval over people."
    )
    note += f" {star_note(report)}." if star_note(report) else ""
    found = f'<table><thead><tr>{head}</tr></thead><tbody id="rows"></tbody></table>'
    each = "".join(table.html() for table in tables_by_setting(report))
    return f'<noscript>{each}</noscript>{_POOLED}<div class="wide">{found}</div><p class="note">{note}</p>'
