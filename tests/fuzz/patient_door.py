"""The whole patient under fire: honest streams, and hostile messages on every key that it listens to."""

import json
import random
from collections.abc import Iterator
from typing import Any, Final, NamedTuple

from tests.fuzz.episode import Episode, Log
from tests.fuzz.fuzzed_worlds import METHODS, SESSION, Packet, World, honest_stream, world
from tests.fuzz.hostile import (
    Raw,
    an_extreme,
    bytes_of,
    damaged,
    odd_fields,
    odd_header,
    odd_rotation,
    with_extremes,
)
from tis.common.channels import Hand, arm_key, stop_key
from tis.common.node import Arrival, Record
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.patient_side.build import build_patient
from tis.patient_side.node import PatientNode

_BOTH: Final[tuple[Hand, ...]] = ("left", "right")
_WAYS: Final = ("gripper", "position", "rotation", "instant", "history", "near", "extremes", "fields", "damaged")
"""Kinds of hostile samples. An episode uses some of them, so that one that is soon refused hides no other."""


class _Event(NamedTuple):
    recv_ns: int
    number: int
    key: str
    payload: bytes
    attachment: bytes
    is_honest: bool


def patient_episode(episode: Episode, quick: bool = False) -> Iterator[None]:
    """Run one patient to its end, step by step."""
    rng = episode.rng
    rate_hz, hands = (30, _BOTH) if quick or rng.random() < 0.8 else (1000, ("left",))
    made = world(rate_hz, hands, quick)
    copies, history = rng.choice(((1, 0), (1, 0), (1, 4), (3, 0), (3, 3)))
    scenario = made.scenario(
        **_estimation(rng, made),
        surgeon={"copies": copies, "copy_spacing_ms": 3 if copies > 1 else 0, "history": history},
        patient=_patient(rng, quick),
    )
    node = build_patient(scenario, made.models, made.recording)
    run_id = rng.choice((0, 7))
    node.join(run_id, rng.choice((0, 0, 0, NS_PER_S // 2)))
    events = _events(rng, honest_stream(rate_hz, hands, quick, copies, history), hands, run_id, NS_PER_S // rate_hz)
    yield
    with Log("patient") as log:
        yield from _run(episode, node, events, log)
        now_ns = scenario.end_ns
        for record in node.finish(now_ns):
            log.keep(record)
        yield
        if rng.random() < (0.1 if quick else 0.3):
            log.read_back()
            yield


def _run(episode: Episode, node: PatientNode, events: list[_Event], log: Log) -> Iterator[None]:
    rng, at, keys = episode.rng, 0, {key for _, key in node.listens()}
    while True:
        wake_ns = node.next_wake_ns()
        event = events[at] if at < len(events) else None
        if event is not None and (wake_ns is None or event.recv_ns <= wake_ns):
            at += 1
            if event.key not in keys:  # an arm or a stop that this patient does not listen to
                continue
            episode.given(event.key, event.payload, event.attachment)
            arrival = Arrival("east", event.key, event.payload, event.attachment, event.recv_ns)
            outputs = log.take(node.receive(arrival), event.recv_ns)
            if event.is_honest:
                episode.n_used += any(isinstance(one, Record) and one.topic == event.key for one in outputs)
        elif wake_ns is not None:
            late_ns = (
                rng.choice((0, 10_000, 10_000, 200_000)) if rng.random() < 0.98 else rng.randrange(NS_PER_S // 2)
            )
            log.take(node.wake(wake_ns + late_ns), wake_ns + late_ns)
        else:
            return
        if rng.random() < 0.02:
            json.dumps(node.counters())
        yield


def _estimation(rng: random.Random, made: World) -> dict[str, Any]:
    beside = rng.sample(made.estimators, rng.randint(0, min(4, len(made.estimators) - 1)))
    active = rng.choice(made.estimators)
    return {"estimators": tuple(dict.fromkeys((active, *beside))), "active_estimator": active}


def _patient(rng: random.Random, quick: bool) -> dict[str, Any]:
    methods = rng.sample(METHODS, rng.randint(1, len(METHODS)))
    plants: list[dict[str, Any]] = [
        {"kind": "replay"},
        {"kind": "servo", "damping": rng.choice((0.1, 1)), "sensor_noise_mm": rng.choice((0, 0, 1))},
        {"kind": "external"},
        *([] if quick else [{"kind": "mujoco"}]),
    ]
    gates: list[dict[str, Any]] = [
        {},
        {},
        {"reach_m": 1e6, "speed_m_s": 1e13, "acceleration_m_s2": 1e16, "lead_ms": 1000},
        {"reach_m": 1000, "speed_m_s": 1e5, "acceleration_m_s2": 1e9},
    ]
    safety: list[dict[str, Any]] = [
        {},
        {"enabled": False},
        {"latch": True, "hold_age_ms": 60, "slow_stop_age_ms": 120, "safe_age_ms": 200, "break_ms": 50},
        {"workspace_m": 1e6, "speed_m_s": 1e9, "acceleration_m_s2": 1e9, "max_std_mm": 1e16},
    ]
    plant = rng.choice(plants)
    if plant["kind"] == "external":  # it follows set points, which need a safety state
        del safety[1]
    return {
        "tick": rng.choice(("free", "phase_locked", "on_arrival")),
        "tick_phase_ms": rng.choice((0, 0.5)),
        "plant": plant,
        "orientation": {"methods": methods, "active": methods[0]},
        "gate": rng.choice(gates),
        "safety": rng.choice(safety),
    }


def _events(
    rng: random.Random, stream: list[Packet], hands: tuple[Hand, ...], run_id: int, period_ns: int
) -> list[_Event]:
    """Return honest packets, some lost and all late, and hostile ones among them."""
    ways = rng.sample(_WAYS, rng.randint(1, 4))
    most_rad = rng.choice((1e7, 1e7, 1e7, 1e400))  # mostly none that is extrapolated beyond what a message can hold
    share = rng.choice((0.02, 0.1, 0.4)) * (1.0 if period_ns > NS_PER_MS else 0.2)
    delay_ns, p_loss = rng.randrange(2 * period_ns + 1), rng.choice((0.0, 0.1, 0.5))
    found: list[_Event] = []

    def add(recv_ns: int, key: str, payload: bytes, attachment: bytes, is_honest: bool = False) -> None:
        found.append(_Event(max(0, recv_ns), len(found), key, payload, attachment, is_honest))

    for packet in stream:
        header = packet.header._replace(run_id=run_id)
        recv_ns = packet.due_ns + delay_ns + rng.randrange(period_ns // 3 + 1)
        if rng.random() >= p_loss:
            add(recv_ns, packet.key, packet.payload, header.pack(), True)
        if rng.random() < share:
            payload = _hostile_sample(rng, json.loads(packet.payload), rng.choice(ways), period_ns, most_rad)
            attachment = header.pack() if rng.random() < 0.8 else odd_header(header, rng)
            sooner_ns = rng.choice((-period_ns, 0, delay_ns // 2, delay_ns, delay_ns + period_ns, NS_PER_S))
            for _ in range(rng.choice((1, 1, 1, 2, 5))):
                add(packet.due_ns + sooner_ns, packet.key, payload, attachment)
        if rng.random() < share:
            key, payload = _hostile_other(rng, hands)
            add(recv_ns, key, payload, rng.choice((b"", header.pack(), odd_header(header, rng))))
    return sorted(found)


def _hostile_sample(rng: random.Random, pose: dict[str, Any], way: str, period_ns: int, most_rad: float) -> bytes:
    match way:
        case "gripper":
            pose["gripper_rad"] = an_extreme(rng)
        case "position":
            pose["position_m"] = {**pose["position_m"], rng.choice("xyz"): an_extreme(rng)}
        case "rotation":
            pose["orientation"] = odd_rotation(rng)
        case "instant":
            ends = (0, -1, 1, 2**62, -(2**62), 2**63, pose["sample_ns"] + 10**9)
            near = [pose["sample_ns"] + by for by in (-1, 1, period_ns, -period_ns, period_ns // 2, 30 * period_ns)]
            pose["sample_ns"] = rng.choice((*ends, *near))
        case "history":
            pose["history"] = _odd_history(rng, pose, period_ns)
        case "near":  # valid, and nearly the true one: what only the right number makes believable
            pose["position_m"] = {axis: pose["position_m"][axis] + rng.gauss(0.0, 0.05) for axis in "xyz"}
            pose["gripper_rad"] = rng.choice((pose["gripper_rad"], Raw("1e9"), Raw("-1e9"), Raw("1e-300")))
            pose["orientation"] = rng.choice((pose["orientation"], odd_rotation(rng)))
        case "extremes":
            pose = with_extremes(pose, rng)
        case "fields":
            return bytes_of(odd_fields(pose, rng))
        case _:
            return damaged(bytes_of(pose), rng)
    past = pose.get("history")
    for one in (pose, *(past if isinstance(past, list) else ())):
        if "gripper_rad" in one and _is_beyond(one["gripper_rad"], most_rad):
            one["gripper_rad"] = 0.5
    return bytes_of(pose)


def _is_beyond(value: Any, most: float) -> bool:
    try:
        return abs(float(value)) > most
    except (TypeError, ValueError):
        return False


def _odd_history(rng: random.Random, pose: dict[str, Any], period_ns: int) -> Any:
    now_ns, n = pose["sample_ns"], rng.choice((1, 2, 5, 300))
    plain = {name: value for name, value in pose.items() if name != "history"}
    past = [{**plain, "sample_ns": (now_ns // period_ns - n + i) * period_ns} for i in range(n)]
    exact = [{**plain, "sample_ns": (round(now_ns * 30 / NS_PER_S) - n + i) * NS_PER_S // 30} for i in range(n)]
    kind = rng.randrange(5)
    if kind == 0:
        return past[::-1]
    if kind == 1:
        return [with_extremes(one, rng) for one in exact]
    if kind == 2:
        return [{**one, "gripper_rad": Raw("1e9"), "orientation": odd_rotation(rng)} for one in exact]
    if kind == 3:
        return [{**one, "history": past} for one in past[:3]]
    return rng.choice((exact, past, [], [{}], None, an_extreme(rng)))


def _hostile_other(rng: random.Random, hands: tuple[Hand, ...]) -> tuple[str, bytes]:
    """Return a request to stop, or the pose of an external arm, valid or not, or a message on a key of nobody."""
    kind = rng.randrange(10)
    if kind < 3:
        key = stop_key(SESSION)
        reason = "r" * rng.choice((0, 200, 201))
        value: dict[str, Any] = {"stop": rng.random() < 0.3, "reason": reason, "number": rng.randrange(5)}
    elif kind < 9:
        value = {
            "stamp_ns": rng.choice((None, rng.randrange(10**10))),
            "position_m": {"x": 0.05, "y": 0.0, "z": 0.2},
            "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
            "gripper_rad": 0.3,
            "clutch": False,
            "buttons": [True],
        }
        key = arm_key(SESSION, rng.choice(("PSM1", "PSM2")))
    else:
        return rng.choice(("tis/MTML", "tis/MTMX/measured_cp", "", "tis/**")), b"{}"
    way = rng.randrange(5)
    if way == 0:
        return key, bytes_of(value)
    if way == 1:
        return key, bytes_of(odd_fields(value, rng))
    if way == 2:
        return key, damaged(bytes_of(value), rng)
    if way == 3 and "orientation" in value:
        return key, bytes_of({**value, "orientation": odd_rotation(rng)})
    return key, bytes_of(with_extremes(value, rng))
