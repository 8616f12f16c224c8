"""The protocol page against the code: its keys, messages and numbers, which others build programs on."""

import hmac
import json
import re
import struct
from binascii import crc_hqx
from pathlib import Path
from typing import Any, get_args
from zlib import crc32

import numpy as np
import pytest
from msgspec import DecodeError
from msgspec.structs import fields as struct_fields

from tis.common.channels import VIDEO, Hand, arm_key, camera_key, hand_channels, release_key, stop_key, stopped_key
from tis.common.clocks import Exchanges
from tis.common.device import MAX_BUTTONS, MAX_DEVICE_BYTES, MAX_PER_TICK, DevicePose, Refusal, decode_pose_stamped
from tis.common.messages import (
    MAX_SIZE,
    FeedbackPose,
    Header,
    Message,
    SafetyMode,
    SampledPose,
    SetPoint,
    ShownForce,
    Twist,
    Wrench,
    decode,
)
from tis.common.peer_life import BEAT_EVERY_NS, Beat
from tis.common.runtime.control import ControlKeys, Epoch
from tis.common.scenario import Scenario
from tis.common.scenario.reading import agreed_fields
from tis.common.scenario.sight import CELL
from tis.common.sight.fragments import FRAGMENT_HEAD_BYTES, MAX_FRAME_BYTES, cut
from tis.common.sight.stamp import Stamp, draw_stamps
from tis.common.signing import Proof, code, hello_key, run_keys, said
from tis.common.stop_messages import (
    LATCH,
    MAX_IN_FORCE,
    MAX_REASON_CHARS,
    MAX_REASONS,
    EmergencyStop,
    ReleaseRule,
    StopRefusal,
    StopState,
    lock_of,
)
from tis.common.units import sample_instant_ns
from tis.deploy.run.resolve import resolve
from tis.netem import __main__ as netem_main
from tis.patient_side.external_camera import ForeignFrame
from tis.patient_side.safety.emergency_stop import MAX_ANSWERS_PER_S, MAX_RELEASES_PER_S
from tis.patient_side.safety.gate import Kind, limits_of

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "reference" / "protocol.md").read_text(encoding="utf-8")
OBJECTS = [json.loads(block) for block in re.findall(r"```json\n(.*?)```", PAGE, re.DOTALL)]


def rows(*head: str) -> list[list[str]]:
    """Return the cells of the table with this head."""
    lines = PAGE.splitlines()
    at = lines.index(f"| {' | '.join(head)} |")
    found = []
    for line in lines[at + 2 :]:
        if not line.startswith("|"):
            break
        found.append([cell.strip().strip("`") for cell in line.strip("| ").split(" | ")])
    return found


def the(*fields: str) -> dict[str, Any]:
    """Return the page's one object whose first fields are these."""
    (found,) = [one for one in OBJECTS if tuple(one)[: len(fields)] == fields]
    return dict(found)


def test_headers() -> None:
    vectors = rows("seq", "sent_ns", "run_id", "bytes")
    assert len(vectors) == 3
    for seq, sent_ns, run_id, content in vectors:
        assert Header(int(seq), int(sent_ns), int(run_id)).pack().hex() == content
        fields = struct.pack("<IqI", int(seq), int(sent_ns), int(run_id))
        assert bytes.fromhex(content) == bytes.fromhex("74697302") + fields
    layout = rows("bytes", "type", "content")
    assert [row[0] for row in layout] == ["0-3", "4-7", "8-15", "16-19"]


def test_fragments_and_stamps() -> None:
    (content, _), _ = cut(50, 1671666666, b"abc", 2)
    assert f"\n{content.hex()}\n" in PAGE
    layout = rows("byte", "type", "content of a fragment")
    assert int(layout[-1][0].rpartition("-")[2]) + 1 == FRAGMENT_HEAD_BYTES
    assert f"at most {MAX_FRAME_BYTES >> 20} MiB" in PAGE
    head, frame = content[:32], (50, 0, 2, 3, crc32(b"abc"), 1671666666)
    assert head == b"tiv\x01" + struct.pack("<IIIIIq", *frame)
    assert content[32:] == struct.pack("<I", crc32(b"ab", crc32(head))) + b"ab"
    picture = np.zeros((240, 320, 3), dtype=np.uint8)
    draw_stamps(picture, Stamp(50, 54))
    said = bytes.fromhex("a50000003200000037")
    bits = np.unpackbits(np.frombuffer(said + crc_hqx(said, 0xFFFF).to_bytes(2, "big"), dtype=np.uint8))
    assert (picture[8 : CELL * 5 : CELL, 8::CELL, 0].reshape(-1)[: len(bits)] > 128).tolist() == bits.tolist()


def test_codes_of_signed_messages() -> None:
    publics, digest = ("11" * 32, "22" * 32), "33" * 8
    keys = run_keys(bytes(range(32)), *publics, digest)
    header = Header(1, 33400000, 80901618).pack()
    for found in (
        keys["surgeon"], keys["patient"],
        code(keys["surgeon"], "tis/MTML/measured_cp", header, b'{"sample_ns": 33333333}'),
        hmac.digest(b"0123456789abcdef" * 2, said("surgeon", publics[0], "", digest), "sha256"),
    ):  # fmt: skip
        assert f"`{found.hex()}`" in PAGE


def test_sample_instants_clock_exchanges_and_runs() -> None:
    for rate_hz, k, sample_ns in rows("rate_hz", "k", "sample_ns"):
        assert sample_instant_ns(int(k), int(rate_hz)) == int(sample_ns)
    for row in rows("T1", "T2", "T3", "T4", "offset", "round trip"):
        *stamps, offset_ns, round_trip_ns = map(int, row)
        exchange = Exchanges.of([(stamps[0], stamps[1], stamps[2], stamps[3])])
        assert (exchange.offset_ns[0], exchange.round_trip_ns[0]) == (offset_ns, round_trip_ns)
    for token, run_id, epoch_ns in rows("token", "run_id", "epoch_ns"):
        epoch = Epoch.parse(token.split("/")[-1])
        assert epoch is not None
        assert (epoch.run_id, epoch.epoch_ns) == (int(run_id), int(epoch_ns))
        assert ControlKeys("tis").run("netem", epoch.text) == token


@pytest.mark.parametrize(
    ("model", "fields"),
    [
        (DevicePose, ("stamp_ns", "position_m", "orientation", "gripper_rad", "clutch", "buttons")),
        (ForeignFrame, ("timestamp", "frame_id", "format", "data")),
        (SetPoint, ("sample_ns", "position_m", "orientation", "gripper_rad", "hand", "tick", "mode", "age_ns")),
        (SampledPose, ("sample_ns", "position_m", "orientation", "gripper_rad")),
        (FeedbackPose, ("sample_ns", "position_m", "orientation", "gripper_rad", "tick", "command_sample_ns")),
        (Wrench, Wrench.__struct_fields__),
        (Twist, Twist.__struct_fields__),
        (ShownForce, ShownForce.__struct_fields__),
        (Beat, ("side", "at_ns", "loop_ns", "run_id")),
        (EmergencyStop, ("stop", "reason", "number", "lock")),
        (EmergencyStop, ("stop", "number", "ends", "secret")),
        (StopState, StopState.__struct_fields__),
        (Proof, ("proof", "certificate")),
    ],
)
def test_messages(model: type[Message], fields: tuple[str, ...]) -> None:
    """Each object is one of the model's, with all of its fields that the page requires; others are refused."""
    content = next(one for one in OBJECTS if tuple(one) == fields)
    assert decode(json.dumps(content).encode(), model)
    required = {field.name for field in struct_fields(model) if field.required}
    assert required <= set(content)
    with pytest.raises(DecodeError):
        decode(json.dumps(content | {"more": 1}).encode(), model)


def test_the_fields_of_a_device() -> None:
    described = rows("field", "type", "default", "meaning")
    assert [row[0] for row in described] == list(DevicePose.__struct_fields__)
    assert [row[0] for row in described if row[2] == "required"] == ["position_m"]
    assert f"up to {MAX_BUTTONS} booleans" in PAGE
    assert [row[0] for row in rows("reason", "a message that")] == list(get_args(Refusal))
    assert f"more than {MAX_DEVICE_BYTES} bytes" in PAGE
    assert f"the newest {MAX_PER_TICK} count" in PAGE
    assert MAX_SIZE == 1e9


def test_keys() -> None:
    on_page = {key.strip("`") for row in rows("key", "network", "who publishes", "payload", "header")
               for key in re.split(r", |`, `| \(", row[0]) if "/" in key}  # fmt: skip
    keys = ControlKeys("tis")
    expected = {stop_key("tis"), release_key("tis"), stopped_key("tis"), keys.clock, keys.scenario("netem"), keys.end}
    expected |= {keys.token("SIDE", "DIGEST", mirrored) for mirrored in (False, True)}  # type: ignore[arg-type]
    expected |= {hello_key("tis", "SIDE"), keys.run("SIDE", "RUN"), keys.beat("SIDE")}  # type: ignore[arg-type]
    pairs: tuple[tuple[Hand, Any], ...] = (("left", "PSM2"), ("right", "PSM1"))
    source = resolve("live").source
    assert source.kind == "live"
    for hand, arm in pairs:
        row = hand_channels(hand, arm)
        channels = (row.command, row.arm, row.estimated, row.measured, row.driven, row.force, row.motion, row.shown)
        expected |= {channel.key("tis") for channel in channels} | {arm_key("tis", arm), source.keys.of(hand)}
    expected |= {VIDEO.key("tis"), camera_key("tis")}
    assert on_page == expected


def test_the_answer_to_a_stop() -> None:
    assert [row[0] for row in rows("answer", "meaning")] == list(StopState.__struct_fields__)
    assert [row[0] for row in rows("refused", "a request")] == [each for each in get_args(StopRefusal) if each]
    for secret, lock in rows("secret", "lock"):
        assert lock_of(secret) == lock
    asked, ended = (next(one for one in OBJECTS if field in one) for field in ("lock", "secret"))
    assert (lock_of(ended["secret"]), ended["ends"]) == (asked["lock"], asked["number"])
    assert all(f"`{rule}`" in PAGE or f"release: {rule}" in PAGE for rule in get_args(ReleaseRule))
    assert f"`ends` {LATCH}" in PAGE
    assert f"at most {MAX_IN_FORCE + 1}" in PAGE
    assert f"Beyond {MAX_IN_FORCE} stops" in PAGE
    assert f"the first {MAX_REASON_CHARS} characters of the reasons of the first {MAX_REASONS}" in PAGE
    assert f"after {MAX_RELEASES_PER_S} others" in PAGE
    assert f"answered {MAX_ANSWERS_PER_S} times a second" in PAGE


def test_the_fields_of_the_scenario_and_other_numbers() -> None:
    fields = agreed_fields(resolve("live"))
    told = the("session", "rate_hz", "duration_s", "drain_s", "surgeon.copies")
    assert {name: fields[name] for name in told} == told
    assert {"boot_id", "received_ns", "replied_ns"} in [set(one) for one in OBJECTS]
    assert BEAT_EVERY_NS == 200_000_000
    assert netem_main._LEAD_NS == 150_000_000
    scenario: Scenario = resolve("live")
    gate = limits_of(scenario.patient.gate)
    assert (gate.reach_m, gate.speed_m_s, gate.acceleration_m_s2) == (2.0, 5.0, 200.0)
    source = scenario.source
    assert source.kind == "live"
    master, arm = source.master_at_mm.of_m, source.arm_at_mm.of_m
    assert (master("left"), arm("left")) == ((0.1, -0.05, 0.35), (0.05, 0.025, 0.025))
    assert (master("right"), arm("right")) == ((0.2, 0.05, 0.35), (0.0, 0.025, -0.025))
    assert source.scale == 0.5
    for mode in get_args(SafetyMode):
        assert f"`{mode}`" in PAGE
    refused = " ".join(row[0] for row in rows("where", "what"))
    for kind in get_args(Kind):
        assert f".{kind}" in refused


def test_the_pose_stamped() -> None:
    block = PAGE.split("```text\n")[-1].split("```")[0]
    found = decode_pose_stamped(bytes.fromhex(block.replace("\n", " ")))
    assert found.stamp_ns == 1_000_000_002
    assert (found.position_m, found.orientation) == ((1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0))
