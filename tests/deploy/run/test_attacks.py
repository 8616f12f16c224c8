"""Attacks on a run: somebody on the patient's network sends what the surgeon did not."""

import json
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from math import radians
from pathlib import Path
from typing import Any, cast

import pytest
from mcap.reader import make_reader
from msgspec.structs import replace
from scipy.spatial.transform import Rotation

from tests.deploy.run.attacker import Attacker, Forged
from tests.nodes import a_pose
from tis.common.channels import Side, release_key, stop_key
from tis.common.messages import Quaternion, SetPoint, Vector3, encode
from tis.common.node import Node
from tis.common.runtime.recordings import load_recording
from tis.common.safety_records import QUARANTINE
from tis.common.sources.trajectory import Recording
from tis.common.stop_messages import EmergencyStop
from tis.common.units import NS_PER_MS, NS_PER_S, sample_instant_ns
from tis.deploy.logs.read.load import load_run
from tis.deploy.report.contents import run_warnings
from tis.deploy.report.summarise import build_summary
from tis.deploy.report.summary import Summary
from tis.deploy.run.replay import replay
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, run_twin
from tis.deploy.shell.run_dir import create
from tis.patient_side.identification.model_file import dump_models

COMMAND, ARM = "tis/MTML/measured_cp", "tis/PSM2/setpoint_cp"
RATE_HZ, ATTACK_NS = 30, 4 * NS_PER_S
HOLD = "patient.orientation={methods: [hold], active: hold}"


def _at(k: int, metres: float) -> bytes:
    """Return a pose ``metres`` off along each axis, with the instant of sample ``k``."""
    return encode(a_pose(metres, metres, metres, sample_ns=sample_instant_ns(k, RATE_HZ)))


def _pose(k: int, place_m: Sequence[float], **fields: object) -> bytes:
    """Return a pose at a place with the instant of sample ``k``."""
    x, y, z = place_m
    pose = a_pose(x, y, z, sample_ns=sample_instant_ns(k, RATE_HZ))
    return encode(replace(pose, **fields))


def _pair(at_ns: int, k: int, seq: int, metres: float) -> Iterator[Forged]:
    for key in (COMMAND, ARM):
        yield Forged(at_ns, key, seq, _at(k, metres))


def _now(at_ns: int) -> int:
    return at_ns * RATE_HZ // NS_PER_S


def _stream_ahead() -> Iterator[Forged]:
    """A movement of its own, 0.8 s ahead, for 5 s, under the right numbers."""
    for i in range(150):
        at_ns = ATTACK_NS - 2 * NS_PER_S + i * NS_PER_S // RATE_HZ
        k = _now(at_ns + 800 * NS_PER_MS)
        yield from _pair(at_ns, k, k, 0.05)


ATTACKS: dict[str, tuple[list[Forged], str]] = {
    "one pair 5 m off and 0.9 s ahead, with the last number": (
        [*_pair(ATTACK_NS, _now(ATTACK_NS + 900 * NS_PER_MS), 2**32 - 1, 5.0)], "ahead",
    ),
    "a stream 0.8 s ahead for 5 s": ([*_stream_ahead()], "ahead"),
    "one pair a thousand kilometres off": ([*_pair(ATTACK_NS, _now(ATTACK_NS), _now(ATTACK_NS), 1e6)], "place"),
    "one pair at 1e300 m": ([*_pair(ATTACK_NS, _now(ATTACK_NS), _now(ATTACK_NS), 1e300)], "rejected"),
    "the next 120 numbers, sent early": (
        [one for k in range(124, 244) for one in _pair(ATTACK_NS, k, k, 0.0)], "ahead",
    ),
    "old samples under new numbers": (
        [one for i in range(60) for one in _pair(ATTACK_NS + i, i + 10, i + 150, 0.01)], "number",
    ),
}  # fmt: skip


def _run(run_dir: Path, messages: Sequence[Forged], *settings: str) -> dict[str, Any]:
    scenario = resolve("default", settings or [HOLD], None, 8.0)
    recording = load_recording(scenario)
    nodes, models, _ = build_sides(scenario, recording=recording)
    everybody = cast("dict[Side, Node]", {**nodes, "attacker": Attacker(messages)})
    create(run_dir, scenario)
    run_twin(scenario, everybody, models, run_dir, recording)
    (run_dir / "model.json").write_bytes(dump_models(models))
    summary = build_summary(load_run(run_dir), scenario, models, "twin", 0, "")
    json.dumps(summary, allow_nan=False)
    return summary


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return _run(tmp_path_factory.mktemp("plain") / "run", [])


@pytest.mark.parametrize("name", ATTACKS)
def test_what_the_gate_refuses_changes_no_estimate_and_is_counted(
    tmp_path: Path, undisturbed: dict[str, Any], name: str
) -> None:
    messages, kind = ATTACKS[name]
    found = _run(tmp_path / "run", messages)
    refused = found["quarantined"].get(kind, 0) + found["rejected"]["patient"]
    assert refused == len(messages)
    assert found["accuracy"] == undisturbed["accuracy"]
    for figure in ("sent", "received", "unplanned_loss", "not_sent"):
        assert found["links"]["forward"][figure] == undisturbed["links"]["forward"][figure]
    assert found["valid"], found["problems"]


def test_what_passes_for_a_true_sample_makes_the_run_invalid(tmp_path: Path, undisturbed: dict[str, Any]) -> None:
    """The right instants and numbers, near the arm, before the true samples: only identity could refuse these."""
    messages = [one for k in range(120, 180) for one in _pair(sample_instant_ns(k, RATE_HZ), k, k, 0.02)]
    found = _run(tmp_path / "run", messages)
    assert not found["valid"]
    n_forged = found["links"]["forward"]["not_sent"]
    assert n_forged > 0
    assert any(f"the patient used {n_forged} messages that the surgeon did not send" in p for p in found["problems"])
    assert found["quarantined"]["conflicting"] > 0  # the true samples, under numbers that were taken


@pytest.fixture(scope="module")
def movement() -> Recording:
    return load_recording(resolve("default", (), None, 8.0))


def _true_m(movement: Recording, k: int, shift: int = 0) -> dict[str, list[float]]:
    """Return the true places of sample ``k`` by key, ``shift`` samples later."""
    (hand,) = movement.hands
    row = movement.start + k + shift
    return {COMMAND: hand.command.position_m[row].tolist(), ARM: hand.follower.position_m[row].tolist()}


def _shaped(movement: Recording, of: Callable[[int, list[float]], list[float]], shift: int = 0) -> list[Forged]:
    """Return a forged stream for three seconds, each message just before the true one under its number."""
    return [
        Forged(sample_instant_ns(k, RATE_HZ) + NS_PER_MS, key, k, _pose(k, of(k - 120, place_m)))
        for k in range(120, 210)
        for key, place_m in _true_m(movement, k, shift).items()
    ]


def _drifted(i: int, place_m: list[float]) -> list[float]:
    return [place_m[0] + 0.001 * i, *place_m[1:]]


def _mirrored(i: int, place_m: list[float]) -> list[float]:
    return [place_m[0], place_m[1], -place_m[2]]


@pytest.mark.parametrize("policy", ["hold", "warn"])
@pytest.mark.parametrize("name", ["drift", "replay", "mirror"])
def test_two_contents_under_one_number_hold_the_arm_and_the_run_says_since_when(
    tmp_path: Path, movement: Recording, name: str, policy: str
) -> None:
    """A drift of 1 mm a sample, the movement of two seconds ago, an axis mirrored: an arm can do each of them."""
    of, shift = {"drift": (_drifted, 0), "replay": (lambda _, place: place, -60), "mirror": (_mirrored, 0)}[name]
    found = _run(tmp_path / "run", _shaped(movement, of, shift), HOLD, f"patient.gate.on_conflict={policy}")
    evidence, held_s = found["evidence"], found["safety"]["left"]["time_s"]["hold"]
    assert evidence["conflict"]["n"] > 60
    assert 4.0 <= evidence["conflict"]["begun_s"] <= 4.3
    assert not found["valid"]
    (text,) = [text for text in run_warnings(Summary.model_validate(found)) if "forges" in text]
    if policy == "hold":
        assert held_s > 1.0
        assert "the arm held" in text
        assert found["safety"]["left"]["largest_step_mm"] <= 67.0
        assert replay(tmp_path / "run").identical
    else:
        assert held_s == 0.0
        assert "the arm went on" in text


def test_foreign_set_points_are_counted_told_and_logged(tmp_path: Path) -> None:
    point = encode(SetPoint(
        sample_ns=0, position_m=Vector3(x=0.0, y=0.0, z=0.0), orientation=Quaternion(x=0.0, y=0.0, z=0.0, w=1.0),
        gripper_rad=0.0, hand="left", tick=0, mode="tracking", age_ns=0,
    ))  # fmt: skip
    key = "tis/PSM2/servo_cp"
    messages = [Forged(ATTACK_NS + i * NS_PER_MS, key, i, point if i % 2 or i < 4 else b"{}") for i in range(400)]
    found = _run(tmp_path / "run", messages)
    assert found["evidence"]["foreign_set_point"] == {"n": 400, "begun_s": 4.002}
    assert found["valid"]  # no arm of another program was there to follow them
    assert any("400 set points" in text for text in run_warnings(Summary.model_validate(found)))
    logs = load_run(tmp_path / "run")
    assert len(logs.of("patient", QUARANTINE)) == 7  # ten a second are logged, what is no set point as rejected


_EXTREMES: dict[str, dict[str, object]] = {
    "gripper": {"gripper_rad": 1e9},
    "gripper below": {"gripper_rad": -1e9},
    "no turn": {"orientation": Quaternion(x=0.0, y=0.0, z=0.0, w=0.0)},
    "turned": {"orientation": Quaternion(x=0.0, y=0.0, z=1.0, w=0.0)},
    "huge turn": {"orientation": Quaternion(x=1e9, y=-1e9, z=1e9, w=1e9)},
    "tiny turn": {"orientation": Quaternion(x=1e-300, y=0.0, z=0.0, w=0.0)},
}


@pytest.mark.parametrize("name", _EXTREMES)
def test_true_places_with_another_wrist_end_nothing(tmp_path: Path, movement: Recording, name: str) -> None:
    """Under the true numbers, before the true samples, with all orientation methods."""
    messages = [
        Forged(sample_instant_ns(k, RATE_HZ) + NS_PER_MS, key, k, _pose(k, place_m, **_EXTREMES[name]))
        for k in range(120, 130)
        for key, place_m in _true_m(movement, k).items()
    ]
    methods = "patient.orientation={methods: [tangent_ls, hold], active: tangent_ls}"
    found = _run(tmp_path / "run", messages, methods)
    assert found["ticks"]["count"] == 240
    with (tmp_path / "run" / "patient.mcap").open("rb") as log:
        points = [json.loads(one.data) for _, _, one in make_reader(log).iter_messages(["tis/PSM2/servo_cp"])]
    turns = [Rotation.from_quat([row["orientation"][axis] for axis in "xyzw"]) for row in points]
    assert len(turns) > 200
    assert max((a.inv() * b).magnitude() for a, b in pairwise(turns)) <= radians(80.0) + 1e-6


def test_an_emergency_stop_stops_within_its_bounds_and_the_summary_says_so(tmp_path: Path) -> None:
    """At the largest movement of the two seconds, for three seconds."""
    stop = encode(EmergencyStop(stop=True, number=1))
    release = encode(EmergencyStop(stop=False, number=2, ends=1))
    messages = [
        Forged(3 * NS_PER_S, stop_key("tis"), 0, stop),
        Forged(6 * NS_PER_S, release_key("tis"), 0, release),
    ]
    found = _run(tmp_path / "run", messages)["safety"]["left"]
    assert found["emergency_stops"] == 1
    assert found["stop"]["way_mm"] <= found["stop"]["bound_mm"] <= 10.0
    assert 0.0 < found["stop"]["time_ms"] <= found["stop"]["bound_ms"]
    assert found["time_s"]["safe"] == pytest.approx(3.0, abs=0.1)
