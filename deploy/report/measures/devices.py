"""The summary's ``devices`` and ``external_arms``: what programs of others sent, and what was not used of it."""

from collections.abc import Mapping
from typing import Any, Final, get_args

from tis.common.channels import Hand, Side
from tis.common.devices.records import DEVICES, FOREIGN_SURGEON, Refusal
from tis.common.records import COUNTERS
from tis.common.scenario import Scenario
from tis.common.units import NS_PER_S
from tis.deploy.logs.read.load import RunLogs

MEANING: Final[Mapping[Refusal, str]] = {
    "undecodable": "that were no pose or beyond its limits",
    "not_finite": "with numbers that are not finite",
    "no_rotation": "with a quaternion of length 0",
    "backwards": "with a clock that stood or went back",
    "flooded": "that came too fast, between two ticks",
    "jump": "that jumped, which were not followed",
}
"""Words for each reason of a refusal."""


def devices_summary(logs: RunLogs, scenario: Scenario) -> dict[str, Any]:
    """Return by hand what live devices and external arms sent; nothing where the scenario has none.

    Oracle: logs written record by record, test_devices.
    """
    found: dict[str, Any] = {}
    if scenario.source.kind == "live" and "surgeon" in logs.sides:
        found["devices"] = _by_hand(logs, scenario, "surgeon", "device")
    if scenario.patient.plant.kind == "external" and "patient" in logs.sides:
        found["external_arms"] = _by_hand(logs, scenario, "patient", "arm")
    return found


def is_foreign(logs: RunLogs) -> bool:
    """Tell whether another program was the surgeon, and ours only wrote its log."""
    return "surgeon" in logs.sides and any(row["name"] == FOREIGN_SURGEON for row in logs.of("surgeon", COUNTERS))


def device_texts(summary: Mapping[str, Any]) -> list[str]:
    """Return a sentence on each device and external arm that was silent, or sent what was not used."""
    texts = []
    for key, name in (("devices", "device of the {} hand"), ("external_arms", "external arm of the {} hand")):
        for hand, row in summary.get(key, {}).items():
            whose = f"the {name.format(hand)}"
            if row["poses"] and row["silent_ticks"]:  # without any pose the run is invalid, and says so
                times = "once" if row["silences"] == 1 else f"{row['silences']} times"
                texts.append(f"{whose} was silent {times}, for {row['silent_s']:.1f} s in all: its last pose held")
            refused = [f"{n} {MEANING[reason]}" for reason, n in row["refused"].items() if n]
            if refused:
                texts.append(f"not used of the messages of {whose}: {', '.join(refused)}")
    return texts


def _by_hand(logs: RunLogs, scenario: Scenario, side: Side, head: str) -> dict[Hand, dict[str, Any]]:
    counts = {row["name"]: row["value"] for row in logs.of(side, COUNTERS)}
    rows = logs.of(side, DEVICES)
    found: dict[Hand, dict[str, Any]] = {}
    for hand in scenario.source.hands:
        if f"{head}_poses.{hand}" not in counts:  # a foreign surgeon has its device to itself
            continue
        silent_ticks = counts.get(f"{head}_silent_ticks.{hand}", 0)
        first = [row["at_ns"] for row in rows if row["hand"] == hand and row["event"] == "first"]
        found[hand] = {
            "poses": counts.get(f"{head}_poses.{hand}", 0),
            "first_s": first[0] / NS_PER_S if first else None,
            "silences": counts.get(f"{head}_silences.{hand}", 0),
            "silent_ticks": silent_ticks,
            "silent_s": silent_ticks / scenario.rate_hz,
            "refused": {reason: counts.get(f"{head}_{reason}.{hand}", 0) for reason in get_args(Refusal)},
        }
    return found
