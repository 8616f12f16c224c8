"""``admissible.html``: which networks each estimator admits, on one page without a server."""

import base64
from collections.abc import Mapping
from html import escape
from typing import Any

from tis.deploy.present.page import Page, Section, nonbreaking_units, note, page_html
from tis.deploy.studies.admissible import tables
from tis.deploy.studies.admissible.criterion import Limit

Report = Mapping[str, Any]


def answer(report: Report) -> str:
    """Return the share of the box that each estimator admits, the largest first (oracle: literals, test_page)."""
    limits = " and ".join(Limit(**limit).text for limit in report["limits"])
    shares = sorted(((about["share"], name) for name, about in report["estimators"].items()), reverse=True)
    (most, best), *others = shares
    text = f"With {best}, {limits} holds in {100 * most:.1f} % of the box of networks"
    if others:
        text += f"; {', '.join(f'with {name} {100 * share:.1f} %' for share, name in others)}"
    if report["profiles"]:
        n_inside = sum(one["verdicts"][best]["inside"] for one in report["profiles"])
        text += f". Of {len(report['profiles'])} profiles of the library {n_inside} are admissible with {best}"
    return f"{text}. The 95 % confidence rests on {tables.people_words(report)}."


def admissible_html(report: Report, svg: str | bytes | None) -> str:
    """Return the page; ``svg`` is the figure of the regions, None without one."""
    words = f'<p class="answer">{escape(nonbreaking_units(answer(report)))}</p>'
    sections = [Section("answer", "The answer", markup=words)]
    if svg is not None:
        data = base64.b64encode(svg.encode() if isinstance(svg, str) else svg).decode()
        alt = "The admissible region of each estimator"
        image = f'<img class="regions" alt="{alt}" src="data:image/svg+xml;base64,{data}">'
        sections.append(Section("regions", "Regions", markup=image))
    found = tables.regions(report).html() + note(f"{tables.CAPTION[0].upper()}{tables.CAPTION[1:]}.")
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
