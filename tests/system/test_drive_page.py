"""The arm driven in a real browser, in a real run: a script drags, cuts the network and closes the page."""

import signal
from math import sin
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.system.browser import chromium, live_page
from tests.system.conftest import HOLD, Start
from tests.system.test_view_page import url_of
from tis.common.device_records import TARGET_RUNS
from tis.common.records import COUNTERS, PLANT
from tis.deploy.logs.read.load import load_run
from tis.deploy.report.subjects.display import displayed

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.live

_IS_DRAWN = "() => document.getElementById('late').textContent !== '–'"
_IS_SEEN = """() => document.getElementById('seen').width === 320
  && /\\d m?s$/.test(document.getElementById('seen_age').textContent)"""
_STATUS = "text => document.getElementById('driver').textContent.includes(text)"
_ENDED = "id => document.getElementById(id).textContent === 'The run has ended.'"
_DELAY_IS = "value => document.getElementById('delay').value === value"
_STEP_MS = 25
_TARGET_RUN = {"delay_ms": 300.0, "with_ghost": True, "time_s": 12.5, "path_mm": 402.25, "n_misses": 1}


def _centre(page: "Page") -> tuple[float, float]:
    box = page.locator("#drive").bounding_box()
    assert box is not None
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def _drag(page: "Page", n: int) -> None:
    """Drag an eight in the picture, which ends where it began."""
    x, y = _centre(page)
    page.mouse.move(x, y)
    page.mouse.down()
    for k in range(n):
        page.mouse.move(x + 150 * sin(6.2832 * k / (n - 1)), y + 45 * sin(12.5664 * k / (n - 1)))
        page.wait_for_timeout(_STEP_MS)
    page.mouse.up()


def test_a_dragged_hand_moves_the_arm_late_and_the_ghost_is_ahead_of_the_picture(
    start: Start, model_file: Path
) -> None:
    small = "sight={codec: jpeg, width: 320, height: 240, fps: 10}"
    words = ("--duration-s", "600", *HOLD, "--set", f"identification.train={model_file}", "--set", small)
    tis = start("run", "drive", "--view", *words)  # the test ends it
    url = url_of(tis)
    with chromium() as browser:
        page, found = live_page(browser)
        page.goto(url)
        # a drag that begins before the arm is there is taken as soon as it is
        x, y = _centre(page)
        page.mouse.move(x, y)
        page.mouse.down()
        page.wait_for_function(_IS_DRAWN)
        page.mouse.move(x + 5, y)
        page.wait_for_function(_STATUS, arg="You drive the arm")
        page.mouse.up()
        page.locator("#drive").press("Escape")
        page.wait_for_function(_STATUS, arg="Nobody drives")
        page.wait_for_function(_DELAY_IS, arg="100")
        _drag(page, 160)
        page.wait_for_function(_STATUS, arg="You drive the arm")

        # a second page sees the same, and is told that it must wait
        other, found_there = live_page(browser)
        other.goto(url)
        other.wait_for_function(_IS_DRAWN)
        # a hand that is not touched for 20 s is let go, and a page may need longer to load
        page.locator("#drive").press("ArrowLeft")
        page.wait_for_function(_STATUS, arg="You drive the arm")
        other.wait_for_function(_STATUS, arg="Another page drives the arm")
        other.locator("#drive").hover()
        other.mouse.down()
        other.wait_for_function(_STATUS, arg="Not taken: another page drives the arm")
        other.close()

        # an outage: the picture freezes, and that is said in it
        assert not page.locator("#cut").is_visible()
        outage = page.get_by_label("Outage, ms")
        for wrong in ("abc", "-50"):
            outage.fill(wrong)
            page.get_by_text(f"must be a number from 1 to 60000 (got {wrong})").wait_for()
        outage.fill("60000")
        outage.press("Enter")
        page.locator("#cut").wait_for()
        _drag(page, 60)
        page.wait_for_function(_STATUS, arg="your moves do not reach the arm now")
        page.get_by_role("button", name="Reset").click()
        page.locator("#cut").wait_for(state="hidden")

        # keys drive as well, and the gripper closes
        page.locator("#drive").focus()
        for key in ("ArrowLeft", "ArrowUp", "PageUp", "g", "c", "c"):
            page.keyboard.press(key)
        assert page.get_by_role("button", name="Open the gripper").is_visible()

        # the camera's picture stands beside, with its age, and is driven in its own plane: up is z
        page.wait_for_function(_IS_SEEN)
        depth = page.locator("#depth")
        before = float(depth.input_value())
        page.locator("#seen").press("ArrowUp")
        assert float(depth.input_value()) == before + 1.5

        # a run at targets goes with the next move into the surgeon's log
        page.evaluate("(one) => window.live.take() && window.live.send({ target_run: one })", _TARGET_RUN)

        # a stop is told where one drives
        page.get_by_role("button", name="Stop the arms").click()
        page.get_by_text("You pressed Stop the arms").wait_for()
        page.locator("#no_ghost").wait_for()
        assert page.locator("#ghost_mm").text_content() == "–"
        page.get_by_role("button", name="Release").click()
        page.locator("#halted").wait_for(state="hidden")
        page.locator("#no_ghost").wait_for(state="hidden")

        # one click sets the delay of a task, and shows its first target
        page.get_by_role("button", name="Reset").click()
        page.get_by_text("Reset: done").wait_for()
        page.get_by_role("button", name="600 ms").click()
        page.get_by_text("Bring the arm to target 1 of 9").wait_for()
        for key in ("#key_hand", "#key_ghost"):  # what is not drawn is not explained
            page.locator(key).wait_for(state="hidden")
        page.get_by_text("delay 300 ms").first.wait_for()
        page.wait_for_function(_DELAY_IS, arg="300")
        page.get_by_text("Reset: done").wait_for(state="detached")  # it is true no more
        page.get_by_role("button", name="Give up").click()
        page.locator("#key_hand").wait_for()

        # a task whose delay is changed is over, and what is told of it goes with a stop
        page.get_by_role("button", name="300 ms").click()
        page.get_by_text("Bring the arm to target 1 of 9").wait_for()
        page.wait_for_function(_DELAY_IS, arg="150")
        page.get_by_label("Delay, ms").fill("120")
        page.get_by_label("Delay, ms").press("Enter")
        page.get_by_text("Ended: the delay is no longer that of these targets").wait_for()
        # so is one of another loss, though it does not count yet
        page.get_by_role("button", name="0 ms", exact=True).click()
        page.get_by_text("Bring the arm to target 1 of 9").wait_for()
        page.wait_for_function(_DELAY_IS, arg="0")
        page.get_by_label("Loss, %").fill("80")
        page.get_by_label("Loss, %").press("Enter")
        page.get_by_text("Ended: the network was changed").wait_for()
        page.get_by_role("button", name="Stop the arms").click()
        page.locator("#touching").wait_for(state="hidden")
        page.get_by_role("button", name="Release").click()
        page.get_by_label("Delay, ms").fill("250")
        page.get_by_text("each way: 250 there and 250 back").wait_for()
        page.get_by_label("Which way").select_option("back")
        page.get_by_text("there as it is, 250 back").wait_for()
        outage.fill("7")
        page.get_by_role("button", name="Reset").click()
        page.wait_for_function("() => document.getElementById('outage').value === '1000'")
        page.wait_for_function(_DELAY_IS, arg="100")
        page.get_by_text("each way: 100 there and 100 back").wait_for()
        for width in (1280, 500):
            page.set_viewport_size({"width": width, "height": 900})
            page.wait_for_function("w => document.documentElement.scrollWidth <= w", arg=width)
        assert found == found_there == []

        # the driver closes the page: the run goes on, and the hand holds
        watching, _ = live_page(browser)
        watching.goto(url)
        watching.wait_for_function(_IS_DRAWN)
        page.close()
        watching.wait_for_function(_STATUS, arg="Nobody drives: the hand holds")
        watching.wait_for_timeout(2_000)
        assert tis.process.poll() is None
        # a task that is open at the end of the run ends with it, and not by a change of the network
        watching.get_by_role("button", name="100 ms", exact=True).click()
        watching.get_by_text("Bring the arm to target 1 of 9").wait_for()
        watching.wait_for_function(_DELAY_IS, arg="50")
        tis.process.send_signal(signal.SIGINT)
        watching.wait_for_function("() => document.title.startsWith('tis live: The run has ended')")
        watching.wait_for_function("() => document.getElementById('touching').textContent === 'The run has ended.'")
        for line in ("driver", "left"):
            watching.wait_for_function(_ENDED, arg=line)
    assert tis.wait()[0] == 130

    summary, logs = tis.summary(), load_run(tis.run_dir)
    assert summary["ticks"]["count"] < summary["ticks"]["planned"]
    assert not any("ended early" in text for text in summary["problems"]), "Ctrl-C ends a drive, as the page says"
    counters = {row["name"]: row["value"] for row in logs.of("surgeon", COUNTERS)}
    assert counters["device_poses.left"] > 150
    assert counters["device_undecodable.left"] == counters["device_backwards.left"] == 0
    assert counters["device_silences.left"] >= 1, "a hand that nobody moves is silent, and that is logged"
    (told,) = logs.of("surgeon", TARGET_RUNS)
    assert {name: told[name] for name in _TARGET_RUN} == _TARGET_RUN
    arm_mm = 1e3 * logs.of("patient", PLANT).column("position_m")
    assert np.ptp(arm_mm, axis=0)[:2].min() > 8.0, "the arm went along the eight"
    display = summary["display"]["left"]
    assert display["n"] > 200
    assert display["late_ms"]["p50"] >= 200.0
    assert display["late_ms"]["max"] >= 2_000.0, "the outage"
    # before the outage, whose commands never act, the ghost is ahead of the picture, and nearer to the arm to come
    seen = displayed(logs, "left")
    assert seen is not None
    cut_ns = seen.sample_ns[np.argmax(seen.sample_ns - seen.command_ns > 1_000_000_000)] - 1_500_000_000
    known = np.flatnonzero(np.isfinite(seen.effect_m).all(axis=1) & (seen.sample_ns < cut_ns))
    assert len(known) > 100
    shown_mm, ghost_mm = (
        1e3 * np.linalg.norm(where_m[known] - seen.effect_m[known], axis=1)
        for where_m in (seen.shown_m, seen.predicted_m)
    )
    assert np.square(ghost_mm).sum() < 0.5 * np.square(shown_mm).sum()
    assert all(link["dropped_by"].get("outage", 0) > 30 for link in summary["links"].values())
