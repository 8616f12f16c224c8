"""axe-core on a page: what keeps people from reading or using it. Not part of the project: `npm install axe-core`."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Page

_FILE = Path("node_modules/axe-core/axe.min.js")
_ROOT = Path(__file__).resolve().parents[2]
_RUN = """async () => {
  const values = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]
  const options = { runOnly: { type: "tag", values }, rules: { "focus-order-semantics": { enabled: true } } }
  const { violations } = await axe.run(document, options)
  // in shadow roots are Bokeh's own elements: that the layer which takes its events has no role is not ours to mend
  const ours = (id) => (node) => id !== "focus-order-semantics" || node.target.flat().length === 1
  return violations.flatMap(({ id, help, nodes }) => nodes.filter(ours(id)).map((node) => {
    const why = [...node.any, ...node.all].map((one) => one.message).join("; ")
    return `${id}: ${help}: ${node.target.join(" ")}: ${why}`
  }))
}"""


def axe_file() -> Path:
    """Return axe's script, that of TIS_AXE or in node_modules; skips, with the reason, where there is none."""
    given = os.environ.get("TIS_AXE")
    path = Path(given) if given else _ROOT / _FILE
    if not path.is_file():
        pytest.skip(f"no axe-core here: npm install axe-core, or TIS_AXE=.../axe.min.js (looked at {path})")
    return path


def violations(page: "Page", scheme: Literal["light", "dark"]) -> list[str]:
    """Return what axe finds on an open page in light or dark, a line for each element."""
    page.emulate_media(color_scheme=scheme)
    page.wait_for_function("name => document.documentElement.dataset.scheme === name", arg=scheme)
    if not page.evaluate("() => Boolean(window.axe)"):
        page.add_script_tag(path=axe_file())
    found: list[str] = page.evaluate(_RUN)
    return found
