"""Shell of a self-contained page: head, contents, sections with figures and tables, and Bokeh inline.

Text from runs is escaped; the page's Content-Security-Policy forbids it to fetch anything.
"""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

from tis.deploy.present.palette import TONES, Tone

if TYPE_CHECKING:
    from bokeh.models.layouts import LayoutDOM

    from tis.deploy.present.plot_style import Figure

HERE: Final = Path(__file__).parent
SCRIPTS: Final = ("page.js", "camera.js")
_STYLES: Final = ("tones.css", "page.css")
_UNITS: Final = r"(?:%|ms|mm|\u00b5s|s|Hz|KB|MB|kB/s|N/m|N|mJ|J)"
_GAP: Final = re.compile(rf"(?<=\d) (?={_UNITS}(?!\w))")


@dataclass(frozen=True)
class Section:
    """A section; ``before`` and ``markup`` enclose its figures, of which a None had nothing to draw.

    ``mark`` is shown beside the title, ``beside`` lets figures share a row, ``nothing`` is the text without any.
    ``more`` is the title under which figures are folded. On a wide screen adjacent sections of a ``column``, left
    before right, stand side by side.
    """

    anchor: str
    title: str
    figures: "Sequence[Figure | None]" = ()
    markup: str = ""
    before: str = ""
    mark: str = ""
    beside: bool = False
    nothing: str = "Nothing to draw: the logs hold no data for it."
    more: str = "More figures"
    column: Literal["", "left", "right"] = ""


@dataclass(frozen=True)
class Page:
    """A page: title, name, marks (text, look) under the title, and sections in reading order.

    ``lead`` below the title introduces the page to new readers. Of ``parts`` (name, label), such as two hands, the
    page shows one at a time, the first at first.
    """

    title: str
    name: str
    tags: Sequence[tuple[str, str]]
    sections: Sequence[Section]
    lead: str = ""
    parts: Sequence[tuple[str, str]] = ()


def page_html(page: Page, more_style: str = "", more_script: str = "") -> str:
    """Return a page as one file; ``more_style`` and the elements ``more_script`` follow the shell's own."""
    # these load slowly, and come with the extra `report` only
    from bokeh.resources import Resources
    from jinja2 import Environment, FileSystemLoader

    drawn = [figure for section in page.sections for figure in section.figures if figure is not None]
    plots = [plot for figure in drawn for plot in figure.plots]
    script, divs = _embedded(plots) if plots else ("", ())
    shell = Environment(loader=FileSystemLoader(HERE), autoescape=True, trim_blocks=True, lstrip_blocks=True)
    shell.globals |= {"css": css, "bound": nonbreaking_units}
    return shell.get_template("page.html").render(
        page=page,
        places=dict(zip((plot.id for plot in plots), divs, strict=True)),  # in the order of the plots
        style="".join(map(text_of, _STYLES)) + more_style,
        runtime=Resources(mode="inline", components=["bokeh"]).render_js() if plots else "",
        drawing=script,
        tones=json.dumps([[tone.light, tone.dark] for tone in TONES]),
        script="".join(map(text_of, SCRIPTS)),
        more_script=more_script,
    )


def _embedded(plots: "Sequence[LayoutDOM]") -> tuple[str, Sequence[str]]:
    """Return the script that draws the plots, and their elements; one document keeps their axes linked."""
    from bokeh.document import Document
    from bokeh.embed import components

    from tis.deploy.present.plot_style import THEME

    document = Document()
    with document.models.freeze():  # without it, Bokeh walks all models again for each plot
        for plot in plots:
            document.add_root(plot)
    return components(plots, theme=THEME)


def text_of(name: str) -> str:
    """Return the style or script of this name."""
    return (HERE / name).read_text(encoding="utf-8")


def css(tone: Tone) -> str:
    """Return a tone as a colour of the page's style, for light and dark pages."""
    return f"light-dark({tone.light},{tone.dark})"


def nonbreaking_units(text: str) -> str:
    """Return the text with no-break spaces (U+00A0) between numbers and their units."""
    return _GAP.sub("\u00a0", text)


def folded(title: str, markup: str) -> str:
    """Return markup folded under a title, left out on paper."""
    return f"<details><summary>{escape(title)}</summary>{markup}</details>" if markup else ""


def part(name: str, markup: str) -> str:
    """Return markup that belongs to a part of the page (`Page.parts`)."""
    return f'<div data-of="{escape(name)}">{markup}</div>' if name and markup else markup


def note(text: str) -> str:
    """Return a note below a table or figure, escaped; "" for none."""
    return f'<p class="note">{escape(text, quote=False)}</p>' if text else ""


def problem_list(problems: Sequence[str], warnings: Sequence[str] = ()) -> str:
    """Return a list of problems, then warnings; "" without any."""
    marked = [("bad", "problem", text) for text in problems] + [("open", "warning", text) for text in warnings]
    items = "".join(
        f'<li><strong class="{look}">{word}</strong> {escape(nonbreaking_units(text))}</li>'
        for look, word, text in marked
    )
    return f'<ul class="problems">{items}</ul>' if items else ""
