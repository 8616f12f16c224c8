"""Touch between real processes: forces arrive, runs are replayed, and no killed side leaves a force behind."""

import json
import signal
import time
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader

from tests.deploy.commands import call
from tests.deploy.run.energy_from_logs import vectors
from tests.system.browser import chromium, live_page
from tests.system.conftest import HOLD, Start, StartHere, is_right_but_for_the_machine
from tests.system.test_rejoin import Sides
from tests.system.test_view_page import url_of
from tis.common.channels import Side
from tis.common.runtime.ports import free_endpoints
from tis.deploy.run.replay import replay

pytestmark = pytest.mark.live
_SLOW = ("rate_hz=200", "identification.train_samples=1000", "estimators=[hold]", "touch.environment.distance_mm=-3")
_SCENARIO = """\
version: 1
name: touched
duration_s: 10
on_peer_loss: continue
source: {kind: synthetic, recorder_hz: null}
rate_hz: 100
hosts: {west: WEST, east: EAST}
patient: {plant: {kind: servo}}
identification: {method: arx, train_samples: 1000}
estimators: [hold]
active_estimator: hold
touch: {environment: {kind: wall, position_mm: [0, 0, 80], stiffness_n_m: 50}, force_max_n: 0.5, fade_after_ms: 200}
"""


def _rows(run_dir: Path, side: Side, topic: str) -> list[dict[str, Any]]:
    """Return a side's messages on a topic, of all parts of its log, a cut one too."""
    rows: list[dict[str, Any]] = []
    for path in sorted(run_dir.glob(f"{side}*.mcap")):
        with path.open("rb") as file:
            messages = NonSeekingReader(file).iter_messages(topics=[topic], log_time_order=False)
            with suppress(McapError):  # where the process was killed
                for _, _, one in messages:
                    rows.append(json.loads(one.data))
    return rows


def _shown(run_dir: Path) -> list[dict[str, Any]]:
    return _rows(run_dir, "surgeon", "tis/MTML/servo_cf")


@pytest.mark.parametrize("coupling", ["position_force", "tdpa"])
def test_forces_arrive_in_a_live_run_and_both_sides_are_replayed(run_here: StartHere, coupling: str) -> None:
    settings = (*_SLOW, f"touch.coupling={coupling}")
    words = [word for setting in settings for word in ("--set", setting)]
    tis = run_here("run", "touch", "--duration-s", "3", *words, identified=True)
    code, _, err = tis.wait()
    summary = tis.summary()
    assert is_right_but_for_the_machine(code, summary), (err, summary["problems"])
    assert summary["links"]["feedback"]["keys"]["tis/PSM2/measured_cf"]["received"] > 0
    assert ("tis/MTML/measured_cs" in summary["links"]["forward"]["keys"]) == (coupling == "tdpa")
    assert summary["touch"]["left"]["peak_force_n"] > 0
    assert max(abs(row["force_n"]["z"]) for row in _shown(tis.run_dir)) > 0
    found = replay(tis.run_dir)
    assert found.identical, str(found)


def _begin(sides: Sides) -> None:
    for side in get_args(Side):
        sides.start(side)
    for side in get_args(Side):
        sides.await_word(side, "running for")


@pytest.mark.slow
@pytest.mark.parametrize("killed", ["patient", "netem"])
def test_the_force_fades_when_a_side_is_killed_in_contact(tmp_path: Path, without_report: None, killed: Side) -> None:
    west, east = free_endpoints()
    (tmp_path / "s.yaml").write_text(_SCENARIO.replace("WEST", west).replace("EAST", east))
    with ExitStack() as stack:
        sides = Sides(stack, tmp_path)
        _begin(sides)
        time.sleep(3.0)
        sides.kill(killed)
        assert sides.running["surgeon"].wait(timeout=60) in (0, 3), sides.texts()
    rows = _shown(tmp_path / "run")
    size = np.linalg.norm(vectors(rows, "force_n"), axis=1)
    ages_ns = np.array([row["age_ns"] or 0 for row in rows])
    assert 0.0 < size.max() <= 0.5 * (1 + 1e-12)
    assert (ages_ns > 1_000_000_000).sum() > 50
    assert not size[ages_ns >= 200_000_000].any()


def test_who_presses_by_mouse_drives_a_loop_that_is_stable_and_makes_it_swing_by_a_click(start: Start) -> None:
    tis = start("run", "drive_touch", "--view", "--duration-s", "600", *HOLD, identified=True)
    url = url_of(tis)
    with chromium() as browser:
        page, found = live_page(browser)
        page.goto(url)
        page.locator("#felt").wait_for()
        box = page.locator("#drive").bounding_box()
        assert box is not None
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.mouse.move(x, y)
        page.mouse.down()
        for k in range(1, 41):
            page.mouse.move(x, y + 5 * k)
            page.wait_for_timeout(25)
        page.wait_for_function("() => parseFloat(document.getElementById('felt_words').textContent) > 1")
        page.get_by_text("A pointer cannot push back").wait_for()
        page.mouse.up()
        page.locator("#loop.stable").get_by_text("In theory it swings from").wait_for()
        page.get_by_role("button", name="at 300 ms there and back").click()
        page.locator("#loop.unstable").wait_for()
        page.get_by_role("button", name="at 0 ms there and back").click()
        page.locator("#loop.stable").wait_for()
        assert found == []
    tis.process.send_signal(signal.SIGINT)
    assert tis.wait()[0] == 130
    assert max(row["force_n"]["y"] for row in _shown(tis.run_dir)) > 1.0


@pytest.mark.slow
@pytest.mark.parametrize("killed", ["surgeon", "patient"])
def test_a_side_killed_in_contact_rejoins_and_the_force_comes_back(
    tmp_path: Path, without_report: None, killed: Side
) -> None:
    """The run lasts longer than a process takes to start on a busy machine: nobody joins a run that is over."""
    west, east = free_endpoints()
    scenario = _SCENARIO.replace("duration_s: 10", "duration_s: 40").replace("WEST", west).replace("EAST", east)
    (tmp_path / "s.yaml").write_text(scenario)
    with ExitStack() as stack:
        sides = Sides(stack, tmp_path)
        _begin(sides)
        time.sleep(3.0)
        sides.kill(killed)
        time.sleep(2.0)
        sides.start(killed)
        sides.await_word(killed, "back in the run")
        codes = {process.wait(timeout=90) for process in sides.running.values()}
        assert codes <= {0, 3}, sides.texts()
    run_dir = tmp_path / "run"
    shown = _rows(run_dir, "surgeon", "tis/MTML/servo_cf")
    size, ticks = np.linalg.norm(vectors(shown, "force_n"), axis=1), np.array([row["tick"] for row in shown])
    assert size.max() <= 0.5 * (1 + 1e-12)
    assert min(size[ticks < 300].max(), size[-200:].max()) > 0.0
    contacts = _rows(run_dir, "patient", "/tis/contacts")
    assert contacts[-1]["active"]
    if killed == "surgeon":
        away = int(np.diff(ticks).argmax())
        assert size[away + 1] == 0.0
        # the arm that nobody leads holds, and offers no force; when that began, the surgeon's cut log does not say
        unled = [row["active"] for row in contacts if 0 < ticks[away + 1] - row["tick"] < 100]
        assert unled
        assert not any(unled)
    call("summarize", str(run_dir))
    assert replay(run_dir).identical
