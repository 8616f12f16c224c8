"""Touch between real processes: forces arrive, runs are replayed, and no killed side leaves a force behind."""

import json
import signal
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from mcap.reader import make_reader

from tests.system.browser import chromium, live_page
from tests.system.conftest import HOLD, Start, StartHere, is_right_but_for_the_machine
from tests.system.test_rejoin import Sides
from tests.system.test_view_page import url_of
from tis.common.channels import Side
from tis.common.runtime.process import free_endpoints
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
touch: {environment: {kind: wall, distance_mm: -10, stiffness_n_m: 100}, force_max_n: 0.5, fade_after_ms: 200}
"""


def _shown(run_dir: Path) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = []
    topics = ["tis/MTML/servo_cf"]
    for path in sorted(run_dir.glob("surgeon*.mcap")):
        with path.open("rb") as file:
            rows += [json.loads(one.data) for _, _, one in make_reader(file).iter_messages(topics=topics)]
    return rows


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


@pytest.mark.slow
@pytest.mark.parametrize("killed", ["patient", "netem"])
def test_the_force_fades_when_a_side_is_killed_in_contact(tmp_path: Path, without_report: None, killed: Side) -> None:
    west, east = free_endpoints()
    (tmp_path / "s.yaml").write_text(_SCENARIO.replace("WEST", west).replace("EAST", east))
    with ExitStack() as stack:
        sides = Sides(stack, tmp_path)
        for side in get_args(Side):
            sides.start(side)
        for side in get_args(Side):
            sides.await_word(side, "running for")
        time.sleep(3.0)
        sides.kill(killed)
        assert sides.running["surgeon"].wait(timeout=60) in (0, 3), sides.texts()
    rows = _shown(tmp_path / "run")
    size = np.array([np.linalg.norm([row["force_n"][axis] for axis in "xyz"]) for row in rows])
    ages_ns = np.array([row["age_ns"] or 0 for row in rows])
    assert 0.0 < size.max() <= 0.5 * (1 + 1e-12)
    assert (ages_ns > 1_000_000_000).sum() > 50
    assert not size[ages_ns >= 200_000_000].any()


def test_who_presses_by_mouse_sees_the_force_and_is_told_that_a_pointer_does_not_yield(start: Start) -> None:
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
        assert found == []
    tis.process.send_signal(signal.SIGINT)
    assert tis.wait()[0] == 130
    assert max(row["force_n"]["y"] for row in _shown(tis.run_dir)) > 1.0
