"""Instants read from bytes, against the payloads parsed as JSON."""

import json
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.messages import FeedbackPose, Pose, Quaternion, SampledPose, Vector3, encode
from tis.common.runtime.chunk_writer import MESSAGE_HEAD_BYTES
from tis.deploy.logs.blocks import Block
from tis.deploy.logs.payloads import NO_INSTANT, payload_instants

INSTANTS = st.integers(0, 9) | st.integers(0, 10**18 - 1) | st.integers(-(10**12), 2**62)
POSE: dict[str, Any] = {
    "position_m": Vector3(x=0.5, y=-1e-9, z=3.0),
    "orientation": Quaternion(x=0.0, y=0.0, z=0.0, w=1.0),
}


def _bytes(sample_ns: int, command_ns: int | None, kind: str) -> bytes:
    pose: dict[str, Any] = {"sample_ns": sample_ns, "gripper_rad": 0.0, **POSE}
    if kind == "feedback":
        return encode(FeedbackPose(**pose, tick=3, command_sample_ns=command_ns))
    if kind == "history":
        before = Pose(**{**pose, "sample_ns": max(sample_ns, 1) - 1})
        now = SampledPose(**{**pose, "sample_ns": max(sample_ns, 1)}, history=(before,))
        return encode(now)
    if kind == "spaced":
        return json.dumps({"command_sample_ns": command_ns, "x": [1], "sample_ns": sample_ns}).encode()
    if kind == "short":
        return json.dumps({"sample_ns": sample_ns}, separators=(",", ":")).encode()
    if kind == "none":
        return b"[1,2]"
    return encode(SampledPose(**pose))


KINDS = st.sampled_from(["sampled", "feedback", "history", "spaced", "short", "none"])


@settings(max_examples=60)
@given(st.lists(st.tuples(INSTANTS, st.integers(0, 10**18 - 1) | st.none(), KINDS), max_size=12))
def test_the_instants_are_those_of_the_json(messages: list[tuple[int, int | None, str]]) -> None:
    payloads = [_bytes(*message) for message in messages]
    body, start, end = b"", [], []
    for payload in payloads:
        start.append(len(body))
        body += bytes(MESSAGE_HEAD_BYTES) + payload
        end.append(len(body))
    none = np.zeros(len(payloads), dtype=np.int64)
    ends = np.array(end, dtype=np.int64)
    block = Block(body, np.array(start, dtype=np.int64), ends, none, none, none, none)
    which = np.arange(len(payloads))[::-1]
    own_ns, command_ns = payload_instants(block, which)
    rows = [json.loads(payloads[i]) for i in which]
    asked = [row if isinstance(row, dict) else {} for row in rows]
    for name, found in (("sample_ns", own_ns), ("command_sample_ns", command_ns)):
        expected = [row.get(name) for row in asked]
        assert found.tolist() == [NO_INSTANT if ns is None else ns for ns in expected]
