"""Forces of touch as viewers draw them: arrows at the tool and at the hand."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from scipy.spatial.transform import Rotation

from tis.deploy.logs.viewer.draw_forces import Places
from tis.deploy.logs.viewer.foxglove import arrow


@pytest.mark.parametrize("force_n", [(1.0, 0.0, 0.0), (-2.0, 0.0, 0.0), (0.0, 3.0, 0.0), (1.0, -2.0, 2.0)])
def test_an_arrow_points_along_its_force_and_is_as_long(force_n: tuple[float, float, float]) -> None:
    (entity,) = SceneUpdate.FromString(arrow(1_500_000_000, "tool", (0.1, 0.2, 0.3), force_n, (1, 0, 0))).entities
    (one,) = entity.arrows
    turn, size = one.pose.orientation, float(np.linalg.norm(force_n))
    along = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).apply([1.0, 0.0, 0.0])
    assert along * size == pytest.approx(force_n, abs=1e-6)
    assert one.shaft_length + one.head_length == pytest.approx(0.005 * size)
    assert (entity.timestamp.seconds, entity.timestamp.nanos) == (1, 500_000_000)


def test_no_force_is_no_arrow() -> None:
    (entity,) = SceneUpdate.FromString(arrow(0, "tool", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (1, 0, 0))).entities
    assert len(entity.arrows) == 0


def test_an_arm_is_where_it_last_was_for_a_second() -> None:
    places = Places()
    places.note(100, (1.0, 0.0, 0.0))
    places.note(200, (2.0, 0.0, 0.0))
    assert [places.at(at_ns) for at_ns in (99, 100, 199, 200)] == [None, *[(1.0, 0.0, 0.0)] * 2, (2.0, 0.0, 0.0)]
    assert places.at(1_000_000_201) is None


def test_what_is_drawn_is_what_was_logged(touch_dir: Path) -> None:
    drawn: dict[str, list[Any]] = {}
    with (touch_dir / "run.mcap").open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            decode = DecoderFactory().decoder_for(channel.message_encoding, schema)
            row = json.loads(message.data) if decode is None else decode(message.data)
            drawn.setdefault(channel.topic, []).append(row)
    for where, log in (("tool", "/patient/tis/PSM2/measured_cf"), ("hand", "/surgeon/tis/MTML/servo_cf")):
        logged = [row["force_n"] for row in drawn[log]]
        sizes = drawn[f"/metrics/force/{where}"]
        assert [row["force_n"] for row in sizes] == logged
        assert max(row["size_n"] for row in sizes) > 0.2
        arrows = [one for update in drawn[f"/forces/{where}"] for entity in update.entities for one in entity.arrows]
        assert len(arrows) > 50
    at = arrows[-1].pose.position
    place = next(row["position_m"] for row in drawn[log][::-1] if row["force_n"]["x"] or row["force_n"]["z"])
    assert (at.x, at.y, at.z) == pytest.approx((place["x"], place["y"], place["z"]), abs=1e-6)
