"""``report.html``: a run as one page that needs no network; the answer first, then how it came about.

Everything that comes from the run (names, commands, paths) is escaped; figures are drawn by the Bokeh that is in the
page itself.
"""

from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Final

from bokeh.document import Document
from bokeh.embed import components
from bokeh.models.layouts import LayoutDOM
from bokeh.resources import Resources

from deploy.report.plot_style import THEME, Figure
from deploy.report.sections import RunView, Section, sections

_STYLE: Final = Path(__file__).with_name("page.css")
# it fetches nothing, and says so to the browser
_POLICY: Final = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"


def report_html(run: RunView) -> str:
    """Return the page of a run. What its logs do not tell is left out and said."""
    parts = sections(run)
    drawn = [figure for section in parts for figure in section.figures if figure is not None]
    script, divs = _embedded([figure.plot for figure in drawn]) if drawn else ("", ())
    plots = {id(figure): div for figure, div in zip(drawn, divs, strict=True)}
    runtime = Resources(mode="inline", components=["bokeh"]).render_js() if drawn else ""
    name = escape(run.scenario.name)
    links = "".join(f'<li><a href="#{section.anchor}">{escape(section.title)}</a></li>' for section in parts)
    body = "".join(_section(section, run, plots) for section in parts)
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{_POLICY}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="generator" content="tis">
<link rel="icon" href="data:,">
<title>{name}: report of a run{" (synthetic)" if run.synthetic else ""}</title>
<style>{_STYLE.read_text(encoding="utf-8")}</style>
</head>
<body>
<header>
<h1>{name}</h1>
<ul class="tags">{_tags(run)}</ul>
<nav aria-label="Contents"><ul>{links}</ul></nav>
</header>
<main>
<noscript><p>The figures need JavaScript; all text and tables are here without it.</p></noscript>
{body}
</main>
<footer><p>Written by tis. What each number means stands in its documentation.</p></footer>
{runtime}
{script}
</body>
</html>
"""


def _embedded(plots: Sequence[LayoutDOM]) -> tuple[str, Sequence[str]]:
    """Return the script that draws the plots, and the element of each; in one document, so that axes stay linked."""
    document = Document()
    with document.models.freeze():  # or Bokeh would look through all models again for each plot
        for plot in plots:
            document.add_root(plot)
    return components(plots, theme=THEME)


def _tags(run: RunView) -> str:
    """Return what must be known before reading a single number."""
    summary = run.summary
    kinds = {"live": "live: real processes, real time", "twin": "twin: virtual time"}
    tags = [("valid measurement", "good") if summary["valid"] else ("not a valid measurement", "bad")]
    if run.synthetic:
        tags.append(("synthetic movement, not a recording of a person", "open"))
    tags += [(summary["source"], ""), (kinds.get(summary["mode"], summary["mode"]), "")]
    tags += [(f"seed {summary['seed']}", ""), (f"{summary['duration_s']:g} s", "")]
    return "".join(f'<li class="tag {look}">{escape(text)}</li>' for text, look in tags)


def _section(section: Section, run: RunView, plots: dict[int, str]) -> str:
    label = ' <span class="tag open">synthetic</span>' if section.moves and run.synthetic else ""
    figures = "".join(_figure(figure, plots[id(figure)]) for figure in section.figures if figure is not None)
    if section.figures and not figures:
        figures = '<p class="note">Nothing to draw: the logs do not tell.</p>'
    if section.beside:
        figures = f'<div class="figures">{figures}</div>'
    title = f"{escape(section.title)}{label}"
    return (
        f'<section id="{section.anchor}" aria-labelledby="{section.anchor}-title">'
        f'<h2 id="{section.anchor}-title">{title}</h2>{section.before}{figures}{section.markup}</section>'
    )


def _figure(figure: Figure, div: str) -> str:
    return (
        f"<figure><figcaption><h3>{escape(figure.title)}</h3><p>{escape(figure.says)}</p></figcaption>"
        f'<div class="plot" role="img" aria-label="{escape(figure.alt)}">{div}</div></figure>'
    )
