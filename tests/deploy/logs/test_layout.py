"""The Foxglove layout names what a run's merged file really holds."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

import tis

LAYOUT = Path(tis.__file__).parent / "deploy" / "foxglove" / "tis.json"


@pytest.fixture(scope="module")
def newest(run_dir: Path, touch_dir: Path) -> dict[str, Any]:
    """Return the last message of each topic of a run without touch, or else of one with it, decoded."""
    found = {}
    for path in (touch_dir, run_dir):
        with (path / "run.mcap").open("rb") as file:
            for schema, channel, message in make_reader(file).iter_messages():
                decode = DecoderFactory().decoder_for(channel.message_encoding, schema)
                found[channel.topic] = json.loads(message.data) if decode is None else decode(message.data)
    return found


def _panels() -> dict[str, dict[str, Any]]:
    panels: dict[str, dict[str, Any]] = json.loads(LAYOUT.read_text(encoding="utf-8"))["configById"]
    return panels


def _leaves(node: Any) -> Iterator[str]:
    if isinstance(node, str):
        yield node
    else:
        yield from _leaves(node["first"])
        yield from _leaves(node["second"])


def test_every_plotted_field_is_a_number_in_the_file(newest: dict[str, Any]) -> None:
    paths = [path["value"] for panel in _panels().values() for path in panel.get("paths", ())]
    assert len(paths) >= 7
    for path in paths:
        topic, field = path.rsplit(".", 1)
        assert isinstance(newest[topic][field], float), path


def test_every_topic_of_the_scene_and_the_log_is_in_the_file(newest: dict[str, Any]) -> None:
    panels = _panels()
    topics = {topic for panel in panels.values() for topic in panel.get("topics", ())}
    topics |= {panel["topicToRender"] for panel in panels.values() if "topicToRender" in panel}
    topics |= {topic for panel in panels.values() for topic in panel.get("imageMode", {}).values()}
    drawn = {"/paths/truth", "/psm", "/mtm", "/estimates/moesp_kf", "/forces/tool", "/forces/hand"}
    assert drawn | {"/log", "/camera"} <= topics
    assert topics <= newest.keys()


def test_the_frames_that_are_followed_are_in_the_file(newest: dict[str, Any], run_dir: Path) -> None:
    scene = next(panel for name, panel in _panels().items() if name.startswith("3D!"))
    frames, parents = set(), set()
    with (run_dir / "run.mcap").open("rb") as file:
        for _, _, _, message in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages("/tf"):
            frames |= {one.child_frame_id for one in message.transforms}
            parents |= {one.parent_frame_id for one in message.transforms}
    assert scene["followTf"] in frames
    assert {scene["fixedFrame"]} == parents
    assert {name.removeprefix("frame:") for name in scene["transforms"]} <= frames


def test_every_panel_has_its_place() -> None:
    layout = json.loads(LAYOUT.read_text(encoding="utf-8"))
    assert sorted(_leaves(layout["layout"])) == sorted(layout["configById"])
