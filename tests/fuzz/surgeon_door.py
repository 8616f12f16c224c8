"""The whole surgeon under fire: answers of the patient, and poses of devices, honest and hostile."""

import json
import random
import struct
from collections.abc import Iterator
from typing import Any, Final

from tests.fuzz.episode import Episode, Log
from tests.fuzz.fuzzed_worlds import SESSION, answer_keys, honest_stream, world
from tests.fuzz.hostile import (
    NUMBERS,
    Raw,
    an_extreme,
    bytes_of,
    damaged,
    odd_fields,
    odd_header,
    odd_rotation,
    with_extremes,
)
from tis.common.channels import Hand
from tis.common.messages import Header, decode
from tis.common.node import Arrival, Emission, Output
from tis.common.units import NS_PER_S
from tis.surgeon_side.build import build_surgeon, build_witness
from tis.surgeon_side.node import SurgeonNode

_HANDS: Final[tuple[Hand, ...]] = ("left", "right")
_DEVICES: Final = ("device/MTML/measured_cp", "device/MTMR/measured_cp")
_BIG: Final = (0.0, -0.0, 5e-324, 1e-300, 1e-6, 0.1, 10.0, 1e3, 1e8, -1e8, 5e8, 1e9, -1e9, 1.1e9, 1e300, float("inf"))


def surgeon_episode(episode: Episode, quick: bool = False) -> Iterator[None]:
    """Run one surgeon, or the witness of a foreign one, to its end, step by step."""
    rng = episode.rng
    rate_hz = 30 if quick or rng.random() < 0.85 else 1000
    yield from rng.choice((_recorded, _live, _live, _witness))(episode, 30 if rate_hz == 30 else rate_hz)


def _recorded(episode: Episode, rate_hz: int) -> Iterator[None]:
    rng, hands = episode.rng, _HANDS if rate_hz == 30 else _HANDS[:1]
    made = world(rate_hz, hands, True)
    redundancy = {
        "copies": rng.choice((1, 3)),
        "history": rng.choice((0, 4)),
        "sensor_noise_mm": rng.choice((0, 100)),
    }
    plant = rng.choice(
        ({"kind": "replay"}, {"kind": "servo"}, {"kind": "servo", "damping": 10, "bandwidth_hz": 1000})
    )
    scenario = made.scenario(surgeon=redundancy, patient={"plant": plant, "tick_phase_ms": 0.5})
    yield from _run(episode, build_surgeon(scenario, made.recording), hands, lambda _: None)


def _live(episode: Episode, rate_hz: int) -> Iterator[None]:
    rng = episode.rng
    encoding = rng.choice(("json", "ros2"))
    source = {
        "kind": "live",
        "hands": _HANDS,
        "encoding": encoding,
        "origin": rng.choice(("first", "zero")),
        "scale": rng.choice((0.01, 0.5, 10)),
        "rotation_deg": rng.choice(((0, 0, 0), (90, 0, 0), (1e-300, 0, 0), (360, -360, 5))),
        "max_speed_mm_s": rng.choice((1e-300, 2000, 100_000)),
        "silent_after_ms": rng.choice((1, 500)),
    }
    made = world(30, _HANDS, True)
    more = {"history": rng.choice((0, 4)), "sensor_noise_mm": rng.choice((0, 100))}
    scenario = made.scenario(
        source=source, surgeon=more, rate_hz=rate_hz, identification={"train": "synthetic"},
        duration_s=4 if rate_hz == 30 else 0.5, patient={"plant": {"kind": "servo"}, "tick_phase_ms": 0.5},
    )  # fmt: skip
    walk = [0.0, 0.0, 0.0]

    def device(now_ns: int) -> tuple[str, bytes] | None:
        if rng.random() < 0.3:
            return None
        for axis in range(3):
            walk[axis] += rng.gauss(0.0, 0.005)
        sample = _device_json(rng, now_ns, walk) if encoding == "json" else _device_ros2(rng, now_ns, walk)
        if rng.random() < 0.03:  # the device stands elsewhere from now on
            walk[:] = [rng.choice((0.0, 1.0, 5e8, -5e8, 9.99e8)) for _ in walk]
        return rng.choice(_DEVICES), sample

    yield from _run(episode, build_surgeon(scenario, made.recording), _HANDS, device)


def _run(episode: Episode, node: SurgeonNode, hands: tuple[Hand, ...], device: Any) -> Iterator[None]:
    rng, answers, run_id = episode.rng, answer_keys(hands), episode.rng.choice((0, 7))
    node.join(run_id, rng.choice((0, 0, 0, NS_PER_S // 3)))
    share, ways = rng.choice((0.05, 0.3)), rng.sample(range(7), rng.randint(1, 4))
    period_ns = NS_PER_S // node.ticker.rate_hz
    models = {
        channel.key(SESSION): channel.payload
        for row in node.motion.channels
        for channel in (row.command, row.arm, row.predicted)
    }
    now_ns, tick = 0, 0
    yield
    with Log("surgeon") as log:
        while (wake_ns := node.next_wake_ns()) is not None:
            for _ in range(rng.choice((0, 1, 1, 2, 5))):  # what arrives before the next sample
                now_ns = min(now_ns + rng.randrange(period_ns // 4 + 1), wake_ns)
                found = device(now_ns)
                if found is not None:
                    key, payload = found
                    if rng.random() < share / 2:
                        payload = damaged(payload, rng)
                    episode.given(key, payload)
                    log.take(node.receive(Arrival("west", key, payload, b"", now_ns)), now_ns)
                    yield
                key, tick = rng.choice(answers), tick + 1
                payload = _answer(rng, now_ns, tick, rng.choice(ways) if rng.random() < share else None)
                header = Header(tick, now_ns, run_id)
                attachment = odd_header(header, rng) if rng.random() < share / 4 else header.pack()
                episode.given(key, payload, attachment)
                outputs = log.take(node.receive(Arrival("west", key, payload, attachment, now_ns)), now_ns)
                yield
            now_ns = max(now_ns, wake_ns + rng.choice((0, 20_000, 500_000)))
            if rng.random() < 0.01:
                now_ns += 10 * period_ns
            outputs = log.take(node.wake(now_ns), now_ns)
            _check_readable(outputs, models)
            yield
        for record in node.finish(now_ns):
            log.keep(record)
        counters = node.counters()
        episode.n_used += counters["received"] + sum(n for name, n in counters.items() if "device_poses" in name)
        json.dumps(counters)
        yield
        if rng.random() < 0.2:
            log.read_back()
            yield


def _check_readable(outputs: list[Output], models: dict[str, Any]) -> None:
    """Check that the other side can read what this side sends."""
    for output in outputs:
        if isinstance(output, Emission):
            decode(output.payload, models[output.key])


def _answer(rng: random.Random, now_ns: int, tick: int, way: int | None) -> bytes:
    """Return an answer of the patient, honest without a ``way``."""
    sample_ns = max(0, now_ns - rng.randrange(NS_PER_S // 10))
    pose: dict[str, Any] = {
        "sample_ns": sample_ns,
        "position_m": {axis: rng.gauss(0.0, 0.01) for axis in "xyz"},
        "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
        "gripper_rad": 0.1,
        "tick": tick,
        "command_sample_ns": rng.choice((None, max(0, sample_ns - rng.randrange(NS_PER_S // 5)))),
    }
    match way:
        case None:
            return bytes_of(pose)
        case 0:
            pose["position_m"] = {**pose["position_m"], rng.choice("xyz"): an_extreme(rng)}
        case 1:
            pose[rng.choice(("tick", "command_sample_ns", "sample_ns"))] = rng.choice(NUMBERS)
        case 2:
            pose["orientation"], pose["gripper_rad"] = odd_rotation(rng), an_extreme(rng)
        case 3:
            pose["command_sample_ns"] = now_ns + rng.choice((-1, 0, 1, NS_PER_S, -NS_PER_S, 10**15, -(10**15)))
            pose["sample_ns"] = rng.choice((0, now_ns, now_ns + NS_PER_S, now_ns + NS_PER_S + 1))
            pose["position_m"] = {axis: rng.choice((Raw("1e9"), Raw("-1e9"), Raw("1e-300"))) for axis in "xyz"}
        case 4:
            return bytes_of(odd_fields(pose, rng))
        case 5:
            return damaged(bytes_of(pose), rng)
        case _:
            return bytes_of(with_extremes(pose, rng))
    return bytes_of(pose)


def _device_json(rng: random.Random, now_ns: int, at_m: list[float]) -> bytes:
    pose: dict[str, Any] = {
        "stamp_ns": rng.choice((None, now_ns)),
        "position_m": dict(zip("xyz", at_m, strict=True)),
        "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
        "gripper_rad": rng.uniform(-1.0, 1.0),
        "clutch": rng.random() < 0.1,
    }
    way = rng.randrange(20)
    if way == 0:
        pose["orientation"] = odd_rotation(rng)
    elif way == 1:
        pose["position_m"] = {axis: rng.choice(_BIG[:13]) for axis in "xyz"}
    elif way == 2:
        return bytes_of(with_extremes(pose, rng))
    elif way == 3:
        return bytes_of(odd_fields(pose, rng))
    return bytes_of(pose)


def _device_ros2(rng: random.Random, now_ns: int, at_m: list[float]) -> bytes:
    values = [*at_m, 0.0, 0.0, 0.0, 1.0]
    way = rng.randrange(20)
    if way == 0:
        values[rng.randrange(7)] = rng.choice((*_BIG, float("nan")))
    elif way == 1:
        values = [rng.choice(_BIG) for _ in values]
    sec = now_ns // NS_PER_S if way != 2 else rng.choice((-(2**31), 2**31 - 1))
    n_chars = rng.choice((1, 6, 8)) if way != 3 else rng.choice((0, 2**31, 2**32 - 1))
    frame = b"world\0\0\0"[: min(n_chars, 8)]
    order = rng.choice("<>")
    head = b"\x00\x01\x00\x00" if order == "<" else b"\x00\x00\x00\x00"
    body = struct.pack(f"{order}iII", sec, now_ns % NS_PER_S, n_chars) + frame
    return head + body + b"\0" * (-len(body) % 8) + struct.pack(f"{order}7d", *values)


def _witness(episode: Episode, rate_hz: int) -> Iterator[None]:
    """Witness a foreign surgeon, whose program may send anything."""
    rng, hands = episode.rng, _HANDS if rate_hz == 30 else _HANDS[:1]
    made, run_id = world(rate_hz, hands, True), rng.choice((0, 7))
    node = build_witness(made.scenario(), made.recording)
    node.join(run_id, 0)
    share, answers, now_ns = rng.choice((0.05, 0.3)), answer_keys(hands), 0
    stream = honest_stream(rate_hz, hands, True, 1, rng.choice((0, 4)))
    yield
    with Log("surgeon") as log:
        for packet in stream:
            now_ns = max(now_ns, packet.due_ns + rng.randrange(1000))
            payload, header = packet.payload, packet.header._replace(run_id=run_id)
            if rng.random() < share:
                pose = json.loads(payload)
                pose["orientation"] = odd_rotation(rng) if rng.random() < 0.5 else pose["orientation"]
                payload = bytes_of(with_extremes(pose, rng)) if rng.random() < 0.7 else damaged(payload, rng)
            attachment = odd_header(header, rng) if rng.random() < share else header.pack()
            key = packet.key
            if rng.random() < 0.3:
                key, payload = rng.choice(answers), _answer(rng, now_ns, header.seq, rng.choice((None, *range(7))))
            episode.given(key, payload, attachment)
            log.take(node.receive(Arrival("west", key, payload, attachment, now_ns)), now_ns)
            yield
        for record in node.finish(now_ns):
            log.keep(record)
        json.dumps(node.counters())
        episode.n_used += node.counters()["sent"]
        yield
        if rng.random() < 0.3:
            log.read_back()
            yield
