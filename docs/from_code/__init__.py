"""Generated pages of the manual, read off the product's code, and the studies' tables: a Sphinx extension."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

from from_code import (
    api,
    commands,
    exit_codes,
    hosts_fields,
    log_topics,
    notebook,
    scenario_fields,
    scoreboard,
    study_fields,
    study_tables,
    summary_keys,
)
from from_code.sources import network_page

PAGES: dict[str, Callable[[], str]] = {
    "reference/commands": commands.page,
    "reference/scenario": scenario_fields.page,
    "reference/hosts": hosts_fields.page,
    "reference/study": study_fields.page,
    "reference/network": network_page,
    "reference/summary": summary_keys.page,
    "reference/logs": log_topics.page,
    "reference/exit_codes": exit_codes.page,
    "reference/api": api.page,
    "testbed/in_python": notebook.page,
}
"""The maker of each page, by the page's name below ``docs/`` without ``.md``; git ignores these files."""


def write_pages(docs: Path) -> None:
    """Write every generated page below ``docs``; a page that has not changed keeps its time of modification."""
    for name, make in PAGES.items():
        path, text = docs / f"{name}.md", make()
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8")


def _with_tables(_: Sphinx, __: str, source: list[str]) -> None:
    source[0] = scoreboard.put_in(study_tables.put_in(source[0], study_tables.tables_of))


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the pages and the tables with Sphinx."""
    app.connect("builder-inited", lambda app: write_pages(Path(app.srcdir)))
    app.connect("source-read", _with_tables)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
