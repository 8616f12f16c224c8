"""Shell of a self-contained page: head, contents, figures, and Bokeh inline.

Text from runs is escaped; the page's Content-Security-Policy forbids it to fetch anything.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Final

from bokeh.document import Document
from bokeh.embed import components
from bokeh.models.layouts import LayoutDOM
from bokeh.resources import Resources

from tis.deploy.report.palette import TONES
from tis.deploy.report.plots.plot_style import THEME, Figure, Key
from tis.deploy.report.tables.html_tables import nonbreaking_units

_STYLES: Final = tuple(Path(__file__).with_name(name) for name in ("tones.css", "page.css"))
_SCRIPTS: Final = tuple(Path(__file__).with_name(name) for name in ("page.js", "camera.js"))
_POLICY: Final = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"


@dataclass(frozen=True)
class Section:
    """A section; ``before`` and ``markup`` enclose its figures, of which a None had nothing to draw.

    ``mark`` is shown beside the title, ``beside`` lets figures share a row, ``nothing`` is the text without any.
    """

    anchor: str
    title: str
    figures: Sequence[Figure | None] = ()
    markup: str = ""
    before: str = ""
    mark: str = ""
    beside: bool = False
    nothing: str = "Nothing to draw: the logs hold no data for it."


@dataclass(frozen=True)
class Page:
    """A page: title, name, marks (text, look) under the title, and sections in reading order.

    ``lead`` below the title introduces the page to new readers.
    """

    title: str
    name: str
    tags: Sequence[tuple[str, str]]
    sections: Sequence[Section]
    lead: str = ""


def page_html(page: Page, more_style: str = "", more_script: str = "") -> str:
    """Return a page as one file; ``more_style`` and the elements ``more_script`` follow the shell's own."""
    drawn = [figure for section in page.sections for figure in section.figures if figure is not None]
    plots = [plot for figure in drawn for plot in figure.plots]
    script, divs = _embedded(plots) if plots else ("", ())
    # Bokeh returns divs in the order of the plots
    places = dict(zip(map(id, plots), divs, strict=True))
    runtime = Resources(mode="inline", components=["bokeh"]).render_js() if plots else ""
    tones = json.dumps([[tone.light, tone.dark] for tone in TONES])
    links = "".join(f'<li><a href="#{s.anchor}">{escape(s.title)}</a></li>' for s in page.sections)
    tags = "".join(f'<li class="tag {look}">{escape(text)}</li>' for text, look in page.tags)
    lead = f'<p class="lead">{escape(page.lead)}</p>' if page.lead else ""
    body = "".join(_section(section, places) for section in page.sections)
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{_POLICY}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<meta name="generator" content="tis">
<link rel="icon" href="data:,">
<title>{escape(page.title)}</title>
<style>{"".join(file.read_text(encoding="utf-8") for file in _STYLES)}{more_style}</style>
</head>
<body>
<a class="skip" href="#{page.sections[0].anchor}">Skip to {escape(page.sections[0].title.lower())}</a>
<header>
<button id="theme" type="button" hidden>Dark page</button>
<h1>{escape(page.name)}</h1>
{lead}<ul class="tags">{tags}</ul>
<nav aria-label="Contents"><ul>{links}</ul></nav>
</header>
<main>
<noscript><p>The figures need JavaScript; all text and tables are here without it.</p></noscript>
{body}
</main>
<footer><p>Written by tis, whose documentation defines each number.</p></footer>
{runtime}
{script}
<script type="application/json" id="tones">{tones}</script>
<script>{"".join(file.read_text(encoding="utf-8") for file in _SCRIPTS)}</script>
{more_script}
</body>
</html>
"""


def _embedded(plots: Sequence[LayoutDOM]) -> tuple[str, Sequence[str]]:
    """Return the script that draws the plots, and their elements; one document keeps their axes linked."""
    document = Document()
    with document.models.freeze():  # without it, Bokeh walks all models again for each plot
        for plot in plots:
            document.add_root(plot)
    return components(plots, theme=THEME)


def _section(section: Section, places: dict[int, str]) -> str:
    drawn = [figure for figure in section.figures if figure is not None]
    figures = "".join(_figure(figure, f"{section.anchor}-{i + 1}", places) for i, figure in enumerate(drawn))
    if section.figures and not (figures or section.markup or section.before):
        figures = f'<p class="note">{escape(section.nothing)}</p>'
    if section.beside and len(drawn) > 1:
        figures = f'<div class="figures">{figures}</div>'
    mark = f' <span class="tag open">{escape(section.mark)}</span>' if section.mark else ""
    return (
        f'<section id="{section.anchor}" aria-labelledby="{section.anchor}-title">'
        f'<h2 id="{section.anchor}-title">{escape(section.title)}{mark}</h2>'
        f"{section.before}{figures}{section.markup}</section>"
    )


def _figure(figure: Figure, anchor: str, places: dict[int, str]) -> str:
    plots = "".join(f'<div class="plot">{places[id(plot)]}</div>' for plot in figure.plots)
    return (
        f'<figure aria-labelledby="{anchor}"><figcaption><h3 id="{anchor}">{escape(figure.title)}</h3>'
        f"<p>{escape(nonbreaking_units(figure.caption))}</p></figcaption>{_keys(figure.keys)}"
        f'<div class="plots" role="group" aria-label="{escape(figure.alt)}">{plots}</div>{figure.controls}</figure>'
    )


def _keys(keys: Sequence[Key]) -> str:
    """Return the legend of a figure; series that can be hidden are buttons."""
    items = []
    for key in keys:
        mark = f'<i class="{key.mark}" style="color:light-dark({key.tone.light},{key.tone.dark})"></i>'
        text = f"{mark}{escape(key.name)}"
        if key.toggles:
            shown = str(key.shown).lower()
            series = escape(key.of or key.name)
            text = f'<button type="button" data-series="{series}" aria-pressed="{shown}">{text}</button>'
        items.append(f"<li>{text}</li>")
    return (
        f'<ul class="keys" aria-label="In the figure; press a name to show or hide it">{"".join(items)}</ul>'
        * bool(keys)
    )
