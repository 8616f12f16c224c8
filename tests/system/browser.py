"""Debian's Chromium, headless, through the playwright wheel: nothing is downloaded for it."""

import importlib.util
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

PATIENCE_MS = 90_000  # what is promised is 5 s on a machine of its own
_FRAME_MS = 100
_SLOW_SCREEN = f"""
const soon = window.requestAnimationFrame.bind(window), never = window.cancelAnimationFrame.bind(window)
const frames = new Map()
window.requestAnimationFrame = (draw) => {{
  const shown = (now) => {{ frames.delete(number); draw(now) }}
  const number = setTimeout(() => frames.set(number, soon(shown)), {_FRAME_MS})
  return number
}}
window.cancelAnimationFrame = (number) => {{ clearTimeout(number); never(frames.get(number)); frames.delete(number) }}
"""
_NAMES = ("chromium", "chromium-browser", "google-chrome")


@contextmanager
def chromium() -> Iterator["Browser"]:
    """Yield a browser; skips, with the reason, where there is none."""
    path = next(filter(None, map(shutil.which, _NAMES)), None)
    if path is None:
        pytest.skip("no Chromium here: apt-get install chromium")
    if importlib.util.find_spec("playwright") is None:
        pytest.skip("playwright is not installed: pip install -e '.[dev]' in the clone")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        # a container has no user namespaces for the sandbox, and what is opened is our own
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        try:
            yield browser
        finally:
            browser.close()


def watched_page(browser: "Browser", width: int = 1280, height: int = 900) -> tuple["Page", list[str]]:
    """Return a new page, and a list to which every error of the page is added from now on."""
    page = browser.new_page(viewport={"width": width, "height": height})
    page.set_default_timeout(PATIENCE_MS)
    found: list[str] = []
    page.on("console", lambda message: found.append(message.text) if message.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: found.append(str(error)))
    page.on("requestfailed", lambda request: found.append(f"{request.url}: {request.failure}"))
    return page, found


def live_page(browser: "Browser") -> tuple["Page", list[str]]:
    """Return the same on a slow screen: a live page draws each frame there is, and would take a whole processor."""
    page, found = watched_page(browser)
    page.add_init_script(_SLOW_SCREEN)
    return page, found
