"""Requests to netem's control, valid ones and such with odd values, and the networks they meet."""

import json
import random
from collections.abc import Callable, Mapping
from typing import Any, Final, get_args

from tests.fuzz.hostile import OTHERS, Raw, an_extreme, bytes_of, damaged, odd_fields, places, put, value_at
from tis.common.channels import Direction
from tis.common.scenario.control import ACKNOWLEDGED, SCHEMA, STATE
from tis.common.trace import parse_opportunities, parse_trace

WAYS: Final[tuple[Direction, ...]] = get_args(Direction)
_BORDERS_TEXT: Final = (
    "0 -0.0 5e-324 1e-300 1e-17 1e-12 1e-9 1e-6 0.0005 0.001 0.0010000001 0.05 0.5 0.9999999999999999 1 "
    "1.0000000000000002 2 16 63 64 999 1000 1000.0001 1500 2000 60000 65535 86400 600000 1000000 3600000 3600000.1 "
    "31536000 86400000 1e7 1e9 1000000000 1e300"
)
_BORDERS: Final = [*map(Raw, _BORDERS_TEXT.split())]
"""Numbers at which the models of requests end."""
_DELAYS: Final[list[dict[str, Any]]] = [
    {"kind": "constant", "delay_ms": 3},
    {"kind": "uniform", "low_ms": 1, "high_ms": 9},
    {"kind": "normal", "mean_ms": 20, "std_ms": 5},
    {"kind": "lognormal", "shift_ms": 1, "max_ms": 900, "mean_ms": 20, "std_ms": 5},
    {"kind": "gamma", "shift_ms": 1, "max_ms": 900, "mean_ms": 20, "std_ms": 5},
    {"kind": "pareto", "shift_ms": 1, "max_ms": 900, "scale_ms": 20, "shape": 2.5},
    {"kind": "hyperexponential", "weights": [0.5, 0.5], "means_ms": [1, 30]},
    {"kind": "quantiles", "points": [{"p": 0, "delay_ms": 1}, {"p": 0.5, "delay_ms": 2}, {"p": 1, "delay_ms": 9}]},
    {"kind": "trace", "path": "a.csv"},
    {"kind": "trace", "path": "b.csv", "advance": "time"},
    {"kind": "trace", "path": "c.up"},
]
TRACES: Final = {
    "a.csv": parse_trace("sent_s,delay_ms\n0,12.25\n0.001,\n0.002,12.5\n5,3600000\n", "a.csv"),
    "b.csv": parse_trace("sent_s,delay_ms\n0,\n0,0\n0,\n", "b.csv"),
    "c.up": parse_opportunities("0\n0\n7\n3600000\n", "c.up"),
}
_LOSSES: Final[list[dict[str, Any]]] = [
    {"kind": "bernoulli", "p_loss": 0.1, "mtu_bytes": 64},
    {"kind": "burst", "p_loss": 0.1, "mean_burst": 3},
    {"kind": "gilbert_elliott", "p_bad": 0.1, "p_good": 0.5, "p_loss_bad": 0.9, "p_loss_good": 0.01},
    {"kind": "four_state", "p13": 0.1, "p31": 0.5, "p32": 0.1, "p23": 0.9, "p14": 0.05},
    {"kind": "pareto_runs", "received": {"shape": 1.5, "scale": 20}, "lost": {"shape": 1.5, "scale": 2}},
    {
        "kind": "gilbert_pareto", "p_bad": 0.1, "p_good": 0.5, "good": {"shape": 2, "scale": 1},
        "bad": {"shape": 2, "scale": 5},
    },
    {"kind": "trace", "path": "a.csv", "advance": "time"},
    {"kind": "trace", "path": "b.csv"},
]  # fmt: skip
_CROSSES: Final[list[dict[str, Any]]] = [
    {"kind": "constant", "kbit_s": 100, "message_bytes": 500},
    {"kind": "on_off", "kbit_s": 100, "message_bytes": 500, "mean_on_s": 0.1, "mean_off_s": 0.2},
    {"kind": "poisson", "kbit_s": 100, "message_bytes": 500},
]
_QUEUES: Final[list[dict[str, Any]]] = [
    {"kind": "tail_drop", "max_packets": 10, "max_bytes": 5000},
    {"kind": "codel", "target_ms": 5, "interval_ms": 100, "max_packets": 10},
    {"kind": "priority", "max_packets": 10, "max_bytes": 5000},
]
_STAGES: Final[Mapping[str, Callable[[random.Random], Any]]] = {
    "delay": lambda rng: rng.choice(_DELAYS),
    "loss": lambda rng: rng.choice(_LOSSES),
    "duplicate": lambda _: {"p_duplicate": 0.3},
    "corrupt": lambda _: {"p_corrupt": 0.5, "bits": 3},
    "rate": lambda rng: rng.choice(
        (
            "link",
            {"kbit_s": 500, "overhead_bytes": 40, "queue": rng.choice(_QUEUES), "cross": rng.choice(_CROSSES)},
            {"kbit_s": 50},
            {"opportunities": "c.up", "opportunity_bytes": 1, "cross": rng.choice(_CROSSES)},
            {"opportunities": "a.csv"},
        )
    ),
    "jitter": lambda rng: rng.choice(({"kind": "normal", "std_ms": 2}, {"kind": "uniform", "half_width_ms": 2})),
    "correlation": lambda rng: {"half_life_s": 0.5, "across_keys": rng.random() < 0.5, "shared": 0.5},
    "reorder": lambda _: {"p_reorder": 0.2, "early_ms": 3},
    "ordering": lambda rng: rng.choice(("fifo", "reorder", "drop_late")),
    "outage": lambda _: True,
    "stall": lambda _: True,
    "clean": lambda _: True,
    "scale_rate": lambda _: 2.0,
    "scale_delay": lambda _: 2.0,
    "add_delay_ms": lambda _: 5.0,
    "add_p_loss": lambda _: 0.1,
}


def a_request(rng: random.Random, now_s: float) -> tuple[str, bytes]:
    """Return an operation and its payload."""
    operation = rng.choice(
        ("set",) * 20 + ("outage", "profile") * 2 + ("reset", STATE, SCHEMA, ACKNOWLEDGED, "x" * 200, "")
    )
    value: Any
    match operation:
        case "set":
            value = [_a_set(rng, now_s) for _ in range(rng.choice((1,) * 6 + (2,) * 4 + (3, 3, 3, 33)))]
            value = value[0] if len(value) == 1 and rng.random() < 0.9 else value
        case "outage":
            value = {"direction": "both", "for_ms": 50, "effect": rng.choice(("loss", "stall"))}
        case "profile":
            value = {"profile": rng.choice(("good", "bad", "none"))}
            if rng.random() < 0.7:
                value["network"] = {way: _pipeline(rng) for way in WAYS}
        case _:
            value = {"id": "a"}
    if rng.random() < 0.6:
        value = _with_borders(value, rng)
    elif rng.random() < 0.2 and isinstance(value, dict):
        value = odd_fields(value, rng)
    payload = bytes_of(value)
    return operation, damaged(payload, rng) if rng.random() < 0.1 else payload


def _a_set(rng: random.Random, now_s: float) -> dict[str, Any]:
    names = rng.sample(list(_STAGES), rng.randint(1, 4))
    found: dict[str, Any] = {
        "direction": rng.choice((*WAYS, "both")),
        "change": {name: _STAGES[name](rng) for name in names},
    }
    if "reorder" in names and rng.random() < 0.9:
        found["change"]["ordering"] = "reorder"
    if rng.random() < 0.3:
        found["at_s"] = now_s + rng.choice((0.001, 0.5, 3))
    if rng.random() < 0.5:
        found["for_s"] = rng.choice((0.001, 0.5, 5))
        if rng.random() < 0.5:
            found["ramp_s"] = found["for_s"] / rng.choice((2, 3, 1e9))
    return found


def _with_borders(value: Any, rng: random.Random) -> Any:
    """Return a request with one to three leaves at the ends of what its model admits, or beyond."""
    found = json.loads(json.dumps(value))
    paths = places(found)
    for _ in range(rng.choice((1, 1, 2, 3)) if paths else 0):
        chosen = rng.random()
        new = rng.choice(_BORDERS) if chosen < 0.8 else an_extreme(rng) if chosen < 0.95 else rng.choice(OTHERS)
        numbers = [path for path in paths if isinstance(value_at(found, path), float | int)]
        put(found, rng.choice(numbers if numbers and rng.random() < 0.85 else paths), new)
    return found


def _pipeline(rng: random.Random) -> dict[str, Any]:
    names = ("delay", "loss", "duplicate", "corrupt", "rate", "jitter", "correlation")
    found = {name: _STAGES[name](rng) for name in rng.sample(names, rng.randint(0, 3))}
    if found.get("delay", {}).get("kind") == "trace":  # has a correlation of its own, and a kind of its own
        del found["delay"]
    if "delay" not in found:
        found.pop("jitter", None)
        found.pop("correlation", None)
    if found.get("rate") == "link" or found.get("rate", {}).get("opportunities") == "a.csv":
        del found["rate"]
    return found


def a_network(rng: random.Random) -> dict[str, Any]:
    """Return a valid network."""
    found: dict[str, Any] = {way: _pipeline(rng) for way in WAYS}
    if rng.random() < 0.3:
        found["outages"] = [{"kind": "periodic", "every_s": 2, "for_s": 0.5, "effect": rng.choice(("loss", "stall"))}]
    if rng.random() < 0.3:
        found["rules"] = [{"key": "tis/MTML/**", "direction": "forward", "pipeline": _pipeline(rng)}]
    if rng.random() < 0.3:
        found["buffer"] = {"max_packets": 20, "policy": rng.choice(("drop_oldest", "drop_newest"))}
    return found
