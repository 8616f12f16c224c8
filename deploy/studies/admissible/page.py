"""``admissible.html``: which networks each estimator admits, on one page without a server."""

import base64
from collections.abc import Mapping
from html import escape
from typing import Any

from tis.deploy.present.page import Page, Section, nonbreaking_units, note, page_html, problem_list
from tis.deploy.studies.admissible import tables

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
