"""A scene in space: what its camera shows is what a rotation of the space gives."""

from pathlib import Path

import numpy as np
import pytest
from bokeh.models import ColumnDataSource
from bokeh.models.ranges import Range1d
from bokeh.plotting import figure
from scipy.spatial.transform import Rotation

from tests.system.browser import chromium, watched_page
from tis.deploy.present.page import Page, Section, page_html
from tis.deploy.present.palette import BLUE, INK
from tis.deploy.present.plot_style import Figure
from tis.deploy.report.plots.scene_3d import TRAIL_S, ScenePath, camera_controls, live_camera_controls, scene

LOW, HIGH = np.array([-10.0, 0.0, 5.0]), np.array([30.0, 20.0, 15.0])
N, RATE_HZ = 100, 10
_DRAWN = (
    "() => window.Bokeh && Bokeh.documents.length && document.querySelector('[data-camera=zoom] + output').innerText"
)
_SET = """([name, value]) => {
  const input = document.querySelector(`[data-camera=${name}]`)
  input.value = value
  input.dispatchEvent(new Event("input", { bubbles: true }))
}"""
_COLUMNS = """([part, name]) => {
  const found = Bokeh.documents[0].get_model_by_name("s").renderers
    .find(({ tags }) => tags[0] === part && (name === null || tags[1] === name))
  return ["u", "v"].map((column) => Array.from(found.data_source.get_column(column)))
}"""
_ARRIVE = """(n) => {
  const paths = Bokeh.documents[0].get_model_by_name("paths")
  const first = (name) => Array.from(paths.get_column(name)).slice(0, n)
  const rows = Object.fromEntries(paths.columns().map((name) => [name, first(name)]))
  const last = paths.get_column("t").at(-1)
  rows.t = rows.t.map((_, i) => last + (i + 1) / n)
  paths.stream(rows, 100)
}"""


def _places() -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    return np.random.default_rng(7).uniform(LOW, HIGH, (N, 3))


def _page(controls: str) -> str:
    places = _places()
    data = {"t": np.arange(N) / RATE_HZ}
    for name, shift in (("arm", 0.0), ("ghost", 1.0)):
        data |= {f"{name} {axis}": places[:, i] + shift for i, axis in enumerate("xyz")}
    source = ColumnDataSource(data | {"ghost error": np.full(N, 3**0.5)}, name="paths")
    flat = figure()
    flat.line("t", "arm x", source=source)
    paths = [
        ScenePath(name, (f"{name} x", f"{name} y", f"{name} z"), tone, "circle", 9, 2)
        for name, tone in (("arm", INK), ("ghost", BLUE))
    ]
    box = {axis: Range1d(start=LOW[i], end=HIGH[i]) for i, axis in enumerate("xyz")}
    drawn = scene("s", source, box, paths)
    figures = [Figure((drawn, flat), "A scene", "A caption.", "A scene", controls=controls)]
    return page_html(Page("t", "t", [], [Section("a", "A", figures)]))


def _seen(azimuth_deg: float, elevation_deg: float) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Return right and up on the screen (N, 2): the space is turned until the camera looks along its y axis."""
    turned = Rotation.from_euler("ZX", [-azimuth_deg - 90, 0], degrees=True)
    tilted = Rotation.from_euler("x", elevation_deg, degrees=True)
    return (tilted * turned).apply(_places() - (LOW + HIGH) / 2)[:, [0, 2]]


@pytest.mark.live
def test_the_camera_shows_what_a_rotation_gives_and_the_slider_moves_the_heads(tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    path.write_text(_page(camera_controls("s", N / RATE_HZ, 5.0)))
    with chromium() as browser:
        page, found = watched_page(browser)
        page.goto(path.as_uri())
        page.wait_for_function(_DRAWN)
        for azimuth_deg, elevation_deg in ((-60, 25), (-90, 0), (35, -20), (120, 90)):
            page.evaluate(_SET, ["azimuth", azimuth_deg])
            page.evaluate(_SET, ["elevation", elevation_deg])
            u, v = page.evaluate(_COLUMNS, ["whole", "arm"])
            assert np.column_stack([u, v]) == pytest.approx(_seen(azimuth_deg, elevation_deg))
        page.evaluate(_SET, ["time", 7.0])
        (head,) = np.column_stack(page.evaluate(_COLUMNS, ["head", "arm"]))
        assert head == pytest.approx(_seen(120, 90)[70])
        assert len(page.evaluate(_COLUMNS, ["trail", "arm"])[0]) == TRAIL_S * RATE_HZ
        assert page.get_by_text("Off the arm at 7.00 s: ghost by 1.73 mm").is_visible()
        page.get_by_role("button", name="Play").click()
        page.get_by_role("button", name="Pause").wait_for()
        page.get_by_role("button", name="Play").wait_for()  # at the end
        assert np.ravel(page.evaluate(_COLUMNS, ["head", "arm"])) == pytest.approx(_seen(120, 90)[-1])
        assert found == []


@pytest.mark.live
def test_a_live_scene_shows_now_until_it_is_paused_and_then_its_last_seconds(tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    path.write_text(_page(live_camera_controls("s", 10)))
    with chromium() as browser:
        page, found = watched_page(browser)

        def head() -> np.ndarray[tuple[int], np.dtype[np.float64]]:
            return np.ravel(page.evaluate(_COLUMNS, ["head", "arm"]))

        page.goto(path.as_uri())
        page.wait_for_function(_DRAWN)
        page.evaluate(_SET, ["azimuth", 35])
        page.evaluate(_SET, ["elevation", -20])
        assert head() == pytest.approx(_seen(35, -20)[-1])
        # paused, it stands at any of its last seconds, whatever arrives
        page.evaluate(_SET, ["time", -2.0])
        assert head() == pytest.approx(_seen(35, -20)[-1 - 2 * RATE_HZ])
        page.evaluate(_ARRIVE, 30)
        page.evaluate(_SET, ["time", -3.0])
        assert head() == pytest.approx(_seen(35, -20)[-1 - 3 * RATE_HZ])
        # playing, it shows what has arrived meanwhile
        page.get_by_role("button", name="Play").click()
        page.get_by_role("button", name="Pause").wait_for()
        assert head() == pytest.approx(_seen(35, -20)[29])
        page.evaluate(_ARRIVE, 1)
        expected = _seen(35, -20)[30].tolist()
        page.wait_for_function(
            f"expected => ({_COLUMNS})(['head', 'arm']).every(([at], i) => Math.abs(at - expected[i]) < 1e-9)",
            arg=expected,
        )
        assert found == []


def test_the_controls_have_names() -> None:
    over_time, live = camera_controls("s", 20, 12.8), live_camera_controls("s", 10)
    for name in ("Time", "Turn", "Tilt", "Zoom"):
        assert f"<span>{name}</span><input" in over_time
        assert f"<span>{name}</span><input" in live
    assert 'max="20" step="0.01" value="12.8"' in over_time
    assert 'min="-10" max="0" step="0.01" value="0"' in live
