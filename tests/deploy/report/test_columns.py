"""Sections that stand side by side, so that a page of many sections is not long."""

import re

from tis.deploy.present.page import Page, Section, page_html
from tis.deploy.report.contents import _in_columns

_ALWAYS = ("answer", "path", "latency", "model", "delay", "network", "repeat")


def _columns(*more: str) -> dict[str, str]:
    anchors = sorted((*_ALWAYS, *more), key=("answer path safety latency model delay network audit repeat").find)
    return {one.anchor: one.column for one in _in_columns([Section(anchor, anchor) for anchor in anchors])}


def test_what_is_short_stands_beside_the_path() -> None:
    assert _columns() == dict.fromkeys(_ALWAYS, "") | {"path": "left", "latency": "right", "model": "right"}
    assert list(_columns("audit"))[:5] == ["answer", "path", "latency", "model", "audit"]
    assert _columns("audit")["audit"] == "right"
    driven = _columns("audit", "safety")
    assert [driven[one] for one in ("path", "safety", "latency", "audit", "repeat")] == [
        "left", "right", "right", "left", "right",
    ]  # fmt: skip


def test_each_group_is_enclosed_once_and_the_sections_keep_their_order() -> None:
    columns = (("a", ""), ("b", "left"), ("c", "right"), ("d", "right"), ("e", "left"), ("f", "right"), ("g", ""))
    page = page_html(Page("t", "t", (), [Section(name, name, column=where) for name, where in columns]))  # type: ignore[arg-type]
    main = page[page.index("<main>") : page.index("</main>")]
    found = re.findall(r'<div class="halves">|</?div>|<section id="(.)"', main)
    marks = re.sub(r"\s+", "", re.sub(r'<section id="(.)".*?</section>', r"\1", main, flags=re.DOTALL))
    marks = marks.partition("</noscript>")[2].replace('<divclass="halves">', "[").replace("<div>", "(").replace(
        "</div>", ")"
    )  # fmt: skip
    assert marks.startswith("a[(b)(cd))[(e)(f))g")
    assert "".join(found) == "abcdefg"
