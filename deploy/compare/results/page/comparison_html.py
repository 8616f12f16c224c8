"""``comparison.html``: filters, curves, map, error against age and table on one page, without a server."""

import json
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any, Final

from tis.deploy.compare.results.orientation_tables import CAPTION, HEAD, orientation_cells
from tis.deploy.compare.results.page.figures import age_figure, curve_figures, heat_figure
from tis.deploy.compare.results.page.page_sums import PageSums
from tis.deploy.compare.results.tables import headline
from tis.deploy.present.page import Page, Section, page_html
from tis.deploy.present.palette import look_of
from tis.deploy.present.table import Column, Table

_SCRIPTS: Final = tuple(Path(__file__).with_name(name) for name in ("pooling.js", "comparison.js"))
_STYLE: Final = Path(__file__).with_name("comparison.css")
_COLUMNS: Final = ("estimator", "R\u00b2 x, %", "y", "z", "3D RMSE, mm", "95 %", "ratio to hold", "95 %", "cover, %")
_COUNTS: Final = ("ticks", "people")
_MARKS: Final = {"solid": "", "dashed": "dashed", "dotted": "dotted", "dashdot": "dashdot"}


def comparison_html(report: dict[str, Any], sums: PageSums) -> str:
    """Return the page; the script pools `sums` again whenever a filter changes."""
    sections = [Section("choose", "What is shown", markup=_filters(sums) + '<p class="note" id="words"></p>')]
    if sums.axes:
        choice = _select("x-axis", "Axis", list(sums.axes))
        sections.append(Section("curves", "Curves", [curve_figures(sums.estimators)], before=choice))
    if len(sums.axes) > 1 and not report["zipped"]:
        paths = list(sums.axes)
        choice = _select("across", "Across", paths, 1) + _select("up", "Up", paths)
        choice += _select("of", "Estimator", _others(sums))
        sections.append(Section("map", "Map", [heat_figure()], before=f'<div class="choices">{choice}</div>'))
    sections += [
        Section("age", "Age", [age_figure(sums.estimators)]),
        Section("table", "Table", markup=_table()),
        *(
            [Section("orientation", "Orientation and gripper", markup=_orientation(report))]
            * bool(report["orientation"])
        ),
        Section("repeat", "How to repeat it", markup=f"<pre><code>{escape(report['command'])}</code></pre>"),
    ]
    synthetic = report["source"] == "synthetic"
    about = _json(sums.about() | {"synthetic": synthetic})
    data = f'<script type="application/json" id="about">{about}</script>'
    data += f'<script type="text/plain" id="sums">{sums.packed()}</script>'
    scripts = "".join(script.read_text(encoding="utf-8") for script in _SCRIPTS)
    title = f"{report['scenario']}: estimators compared"
    tags = [(f"{report['n_computed']:,} twins", ""), (report["source"], "open" if synthetic else "")]
    return page_html(
        Page(title, title, tags, sections, headline(report)),
        more_style=_STYLE.read_text(encoding="utf-8"),
        more_script=f"{data}<script>{scripts}</script>",
    )


def _filters(sums: PageSums) -> str:
    parts = [_chips("estimators", "Estimators", sums.estimators, marks=True)]
    if len(sums.people) > 1:
        parts.append(_chips("people", "People", sums.people))
    if len(sums.hands) > 1:
        parts.append(_chips("hands", "Hands", sums.hands))
    parts += [
        f'<label class="axis" title="{escape(path)}"><span>{escape(path.split(".")[-1])}</span>'
        f'<input type="range" min="0" max="{len(values)}" value="0" step="1" data-axis="{i}">'
        f"<output>all</output></label>"
        for i, (path, values) in enumerate(sums.axes.items())
        if len(values) > 1
    ]
    return f'<div class="filters">{"".join(parts)}</div>'


def _chips(kind: str, title: str, names: Sequence[str], marks: bool = False) -> str:
    """Return buttons, one for each name, that choose it or leave it out; and two for all and none."""
    chips = "".join(
        f'<li><button type="button" data-chip="{kind}" data-place="{i}" aria-pressed="true">'
        f"{_mark(name, names) if marks else ''}{escape(name)}</button></li>"
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
    each = "".join(
        f'<option value="{escape(text)}"{" selected" * (i == chosen)}>{escape(text)}</option>'
        for i, text in enumerate(options)
    )
    return f'<label class="choice">{title} <select id="{name}">{each}</select></label>'


def _others(sums: PageSums) -> Sequence[str]:
    return [name for name in sums.estimators if name != "hold"] or list(sums.estimators)


def _table() -> str:
    head = "".join(f'<th scope="col">{text}</th>' for text in (*_COLUMNS, *_COUNTS))
    note = (
        "Pooled over all that is chosen, every tick with the same weight. Ratio: 3D RMSE over that of hold on the "
        "same ticks. Cover: share of the errors within the 95 % ellipsoid. 95 %: bootstrap interval over people."
    )
    found = f'<table><thead><tr>{head}</tr></thead><tbody id="rows"></tbody></table>'
    return f'<div class="wide">{found}</div><p class="note">{note}</p>'


def _orientation(report: dict[str, Any]) -> str:
    """Return the table of the orientation methods, all that is compared."""
    rows = [(str(row["setting"] or "-"), *orientation_cells(row)) for row in report["orientation"]]
    note = f'<p class="note">{CAPTION}. All people and hands, whatever is chosen above.</p>'
    columns = ("setting", Column(HEAD[0], words=True), *HEAD[1:])
    return Table("Orientation and gripper", columns, rows).html() + note


def _json(value: Any) -> str:
    """Return JSON that no text in it can end the element that holds it."""
    return json.dumps(value, allow_nan=False).replace("<", "\\u003c")
