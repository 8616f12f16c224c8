"""Screenshots of the README and the manual: `make pictures` runs this by hand, in Debian's Chromium.

The report is that of a twin of `default`, so its figures repeat, as does the damaged frame; the live page is that of
a run, so its figures do not.
"""

import re
import shutil
import subprocess
import sys
import tempfile
from io import BytesIO
from math import sin
from pathlib import Path
from typing import Final, Literal

import numpy as np
from PIL import Image
from playwright.sync_api import Browser, FloatRect, Page, ViewportSize, sync_playwright

from tis.common.metrics.sight import psnr_db
from tis.deploy.logs.read.load import load_run, scenario_in
from tis.deploy.report.subjects.pictures import Pictures
from tis.deploy.report.subjects.seen_pictures import seen_pictures
from tis.deploy.shell.run_dir import read_scenario

_FOLDER: Final = Path(__file__).parent / "pictures"
_TIS: Final = Path(sys.executable).with_name("tis")
_WIDTH: Final = 1600
_NARROW: Final = ViewportSize(width=910, height=860)
"""As narrow as the pages have two columns, so that their words are legible in a README 800 px wide."""
_REPORT_VIEW: Final = ViewportSize(width=1000, height=900)
_MAX_BYTES: Final = 150_000
_SCHEMES: Final[tuple[Literal["light", "dark"], ...]] = ("light", "dark")
_PATIENCE_MS: Final = 60_000
_DRAWN: Final = "() => window.Bokeh && Bokeh.documents.length > 0"
_REPORT_EXCERPT: Final = """
nav, body > footer, main > :not(#answer, #error) { display: none !important }
#answer > :not(h2, p.answer, dl.tiles) { display: none !important }
dl.tiles { grid-template-columns: repeat(4, 1fr) !important }
"""
"""Style that leaves of the report its head, its answer and the error over time."""

_DRIVE_EXCERPT: Final = "header p, .pads { display: none !important }"
"""Style that leaves out the introduction and the buttons of the page that drives."""

_LIVE_EXCERPT: Final = """
section > p, section.arm > :last-child, #opening, [role=alert] { display: none !important }
section.network > :nth-child(n + 6):nth-child(-n + 9) { display: none !important }
"""
"""Style that leaves out explanations and two figures of the live page, and what it says when it is slow."""

_OUTAGES: Final = "network.outages=[{kind: periodic, every_s: 4, for_s: 0.7}]"
"""Outages so frequent that any picture of the live page shows some."""


_N_STEPS: Final = 181
"""Steps of the pointer to where its eight crosses itself, and the hand is fastest."""

_STILL: Final = "() => { window.requestAnimationFrame = () => 0 }"
"""Stop the drawing: a busy machine takes no picture of a page that changes all the time."""


def main() -> None:
    """Make all pictures."""
    _FOLDER.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        _damaged_frame(Path(folder))
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        path = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
        if path is None:
            sys.exit("no Chromium here: apt-get install chromium")
        # a container has no user namespaces for the sandbox, and what is opened is our own
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        _report(browser.new_page(viewport=_REPORT_VIEW, device_scale_factor=2), Path(folder) / "twin")
        _live(browser, Path(folder) / "run")
        _drive(browser, Path(folder) / "drive")
        browser.close()


def _damaged_frame(run_dir: Path) -> None:
    """Picture the frame of h264 that losses damaged most, beside what the camera drew."""
    settings = ("sight.codec=h264", "network.feedback.loss.p_loss=0.05", "duration_s=10")
    words = [word for one in settings for word in ("--set", one)]
    command = [_TIS, "twin", "sight", "--run-dir", run_dir, "--no-report", "--no-merge", *words]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    logs = load_run(run_dir)
    scenario = read_scenario(run_dir, scenario_in(logs))
    found = Pictures.of(logs, scenario)
    assert found is not None
    damaged = found.screen.frame[found.screen.where("state", "concealed")].tolist()
    worst = min(
        seen_pictures(run_dir, scenario, found, len(damaged), damaged),
        key=lambda one: psnr_db(one.seen, one.original),
    )
    gap = np.full((worst.seen.shape[0], 16, 3), 255, dtype=np.uint8)
    picture = Image.fromarray(np.hstack([worst.original, gap, worst.seen]))
    picture.save(_FOLDER / "damaged_frame.webp", quality=80, method=6)
    print(f"frame {worst.frame}, PSNR {psnr_db(worst.seen, worst.original):.1f} dB")


def _report(page: Page, run_dir: Path) -> None:
    """Picture the report's answer, and the error over time."""
    subprocess.run(
        [_TIS, "twin", "default", "--run-dir", run_dir, "--no-merge"], check=True, stdout=subprocess.DEVNULL
    )
    for scheme in _SCHEMES:
        page.emulate_media(color_scheme=scheme)
        page.goto((run_dir / "report.html").as_uri())
        page.wait_for_function(_DRAWN, timeout=_PATIENCE_MS)
        page.add_style_tag(content=_REPORT_EXCERPT)
        page.wait_for_timeout(2000)
        further = page.get_by_text("Orientation error over time").bounding_box()
        assert further is not None
        clip = FloatRect(x=0, y=0, width=_REPORT_VIEW["width"], height=further["y"] - 16)
        _save(page.screenshot(full_page=True, clip=clip), "report", scheme)


def _live(browser: Browser, run_dir: Path) -> None:
    """Picture the live page of a run with outages; a busy machine draws it slowly, so no moment is aimed at."""
    words = ("run", "default", "--view", "--duration-s", "180", "--run-dir", run_dir, "--no-report", "--no-merge")
    command = [_TIS, *words, "--set", _OUTAGES]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as tis:
        assert tis.stderr is not None
        url = next(found[0] for line in tis.stderr if (found := re.search(r"http://\S+", line)))
        for scheme in _SCHEMES:
            page = browser.new_page(viewport={"width": 1320, "height": 1500}, color_scheme=scheme)
            page.goto(url)
            page.wait_for_function("() => document.title.startsWith('tis live: Running')", timeout=_PATIENCE_MS)
            page.add_style_tag(content=_LIVE_EXCERPT)
            page.wait_for_timeout(18_000)  # ten seconds are shown
            page.evaluate(_STILL)
            height = page.evaluate("document.querySelector('main').getBoundingClientRect().bottom") + 20
            clip = FloatRect(x=0, y=0, width=1320, height=height)
            _save(page.screenshot(timeout=_PATIENCE_MS, clip=clip), "live", scheme)
            page.close()
        tis.terminate()


def _drive(browser: Browser, run_dir: Path) -> None:
    """Picture the surgeon's display while a hand is dragged along an eight, with the arm 200 ms behind."""
    words = ("run", "drive", "--view", "--run-dir", run_dir, "--no-report", "--no-merge")
    with subprocess.Popen([_TIS, *words], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as tis:
        assert tis.stderr is not None
        url = next(found[0] for line in tis.stderr if (found := re.search(r"http://\S+", line)))
        for scheme in _SCHEMES:
            page = browser.new_page(viewport=_NARROW, device_scale_factor=2, color_scheme=scheme)
            page.goto(url)
            page.get_by_text("Nobody drives").wait_for(timeout=_PATIENCE_MS)
            page.add_style_tag(content=_DRIVE_EXCERPT)
            box = page.locator("#drive").bounding_box()
            assert box is not None
            x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
            page.mouse.move(x, y)
            page.mouse.down()
            for k in range(_N_STEPS):
                page.mouse.move(x + 190 * sin(0.07 * k), y + 100 * sin(0.14 * k))
                page.wait_for_timeout(20)
            page.evaluate(_STILL)
            height = page.locator("section.surgeon").bounding_box()
            assert height is not None
            clip = FloatRect(x=0, y=0, width=_NARROW["width"], height=height["y"] + height["height"] + 12)
            _save(page.screenshot(timeout=_PATIENCE_MS, clip=clip), "drive", scheme)
            page.close()
        tis.terminate()


def _save(png: bytes, name: str, scheme: Literal["light", "dark"]) -> None:
    """Scale a screenshot and save it as WebP, as good as its size allows."""
    picture = Image.open(BytesIO(png)).convert("RGB")
    picture = picture.resize((_WIDTH, round(picture.height * _WIDTH / picture.width)), Image.Resampling.LANCZOS)
    path = _FOLDER / f"{name}{'' if scheme == 'light' else '_dark'}.webp"
    for quality in range(90, 20, -5):
        picture.save(path, quality=quality, method=6)
        if path.stat().st_size < _MAX_BYTES:
            break
    print(path, picture.size, f"{path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
