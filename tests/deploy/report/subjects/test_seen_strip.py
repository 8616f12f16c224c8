"""The strip of pictures: what stood on the screen at the end of each second, few and small ones."""

import re
from base64 import b64decode
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.deploy.report.subjects.test_sight import MS, camera, logs, screen
from tests.deploy.report.subjects.test_sight import scenario as a_scenario
from tis.common.scenario import Scenario
from tis.deploy.logs.read.load import load_run
from tis.deploy.report.subjects.pictures import Pictures
from tis.deploy.report.subjects.seen_strip import MOST, Moment, _small, moments, strip_markup
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, run_twin


def _seen(screens: list[dict[str, Any]], scenario: Scenario) -> Pictures:
    found = Pictures.of(logs([camera(n) for n in range(40)], screens), scenario)
    assert found is not None
    return found


def test_at_the_end_of_each_second_stands_the_newest_picture_shown_by_then() -> None:
    """Frame n is shown 45 ms after n * 100 ms, and the picture stops with frame 25."""
    found = _seen([screen(n) for n in range(26)], a_scenario())
    assert [(one.at_ns // MS, one.frame) for one in moments(found)] == [(1000, 9), (2000, 19), (3000, 25), (4000, 25)]
    whole, _, still, _ = moments(found)
    assert whole.words("complete") == ""
    assert whole.words("concealed") == "concealed"
    assert still.words("complete") == ""  # for 455 ms
    assert Moment(2000 * MS, 3, 400 * MS).words("concealed").startswith("still for 1")


def test_before_the_first_picture_there_is_none_and_of_a_long_run_there_are_few() -> None:
    late = _seen([screen(n) for n in range(15, 40)], a_scenario())
    assert [one.at_ns // MS for one in moments(late)] == [2000, 3000, 4000]
    long = Pictures(late.camera, late.screen, 10, 600_000 * MS)
    assert len(moments(long)) <= MOST
    assert {one.frame for one in moments(long)} == {39}
    assert moments(_seen([], a_scenario())) == []


def test_a_small_picture_keeps_its_shape_and_has_few_bytes() -> None:
    noise = np.random.default_rng(1).integers(0, 256, (1088, 1920, 3)).astype(np.uint8)
    data = b64decode(_small(noise))
    image = pytest.importorskip("PIL.Image")
    with image.open(BytesIO(data)) as small:
        assert small.size == (160, 91)
    assert len(data) < 16_000


@pytest.mark.parametrize("codec", ["jpeg", "h264"])
def test_the_strip_of_a_run_comes_from_its_log(tmp_path: Path, codec: str) -> None:
    pytest.importorskip("PIL" if codec == "jpeg" else "av", reason="the extra is not installed")
    settings = ("duration_s=2", f"sight={{codec: {codec}, width: 320, height: 240}}", "estimators=[hold]")
    scenario = resolve("default", (*settings, "active_estimator=hold"), None, None)
    nodes, models, _ = build_sides(scenario)
    run_twin(scenario, nodes, models, tmp_path)
    found = Pictures.of(load_run(tmp_path), scenario)
    markup = strip_markup(tmp_path, scenario, found)
    assert re.findall(r'alt="The screen at ([^"]*)"', markup) == ["1 s", "2 s"]
    assert len(markup) < 20_000
    assert strip_markup(tmp_path / "elsewhere", scenario, found) == strip_markup(tmp_path, scenario, None) == ""
