"""Programs of others: what live devices and external arms sent, and what was not used of it."""

from collections.abc import Mapping
from typing import Final, get_args

from tis.common.channels import Hand, Side
from tis.common.device import Refusal
from tis.common.device_records import DEVICES, FOREIGN_SURGEON
from tis.common.errors import problem
from tis.common.scenario import Scenario
from tis.common.sight_records import CameraRefusal
from tis.common.units import NS_PER_S
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.report.section import Section, means
from tis.deploy.report.subjects.logs import counters_of


class DeviceFigures(Section):
    """What the device of a hand, or its external arm, sent."""

    poses: int = means("Poses that were used.")
    first_s: float | None = means("Run time of its first pose.")
    silences: int = means("Times without a pose for longer than `silent_after_ms`.")
    silent_ticks: int = means("Ticks in them.")
    silent_s: float = means("Time in them, by the ticks, from `silent_after_ms` on; no measure of rest.")
    refused: dict[Refusal, int] = means(
        "Messages that were not used, by reason: undecodable, not_finite, no_rotation (a quaternion of "
        "length 0), backwards (its clock stood or went back), flooded (more than 128 between two ticks), jump (a "
        "tick at which it moved faster than `source.max_speed_mm_s`)."
    )


class CameraFigures(Section):
    """What an external camera sent."""

    frames: int = means("Frames that were sent on.")
    undated: int = means("Those without a timestamp, or with one that cannot be true: their arrival counted.")
    unreadable: int = means("Those that reached the screen whole, refer to no other frame, and were no picture.")
    refused: dict[str, int] = means(
        "Messages that were not used, by reason: undecodable (no CompressedImage or CompressedVideo), other_format "
        "(than `sight.codec`), flooded (more than twice `sight.fps`), unread (over 3 MiB, or while 8 waited)."
    )


ByHand = Mapping[Hand, DeviceFigures]
MEANING: Final[Mapping[Refusal, str]] = {
    "undecodable": "that were no pose or beyond its limits",
    "not_finite": "with numbers that are not finite",
    "no_rotation": "with a quaternion of length 0",
    "backwards": "with a clock that stood or went back",
    "flooded": "that came too fast, between two ticks",
    "jump": "that jumped, which were not followed",
}
"""Words for each reason of a refusal."""
_OF_CAMERAS: Final[Mapping[str, str]] = {
    "undecodable": "that were no frame",
    "other_format": "of another format than sight.codec",
    "flooded": "that came faster than twice sight.fps",
    "unread": "that were too long or too many at once",
}


def devices_summary(logs: RunLogs, scenario: Scenario) -> dict[str, dict[Hand, DeviceFigures]]:
    """Return by hand what live devices and external arms sent; nothing where the scenario has none.

    Oracle: logs written record by record, test_devices.
    """
    found: dict[str, dict[Hand, DeviceFigures]] = {}
    if scenario.source.kind == "live" and "surgeon" in logs.sides:
        found["devices"] = _by_hand(logs, scenario, "surgeon", "device")
    if scenario.patient.plant.kind == "external" and "patient" in logs.sides:
        found["external_arms"] = _by_hand(logs, scenario, "patient", "arm")
    return found


def camera_summary(logs: RunLogs, scenario: Scenario, unreadable: int) -> dict[str, CameraFigures]:
    """Return what an external camera sent; nothing where the scenario has none. Oracle: as above."""
    if scenario.sight is None or not scenario.sight.is_external or "patient" not in logs.sides:
        return {}
    counts = counters_of(logs, "patient")
    refused = {reason: counts.get(f"camera_{reason}", 0) for reason in get_args(CameraRefusal)}
    figures = CameraFigures(
        frames=counts.get("video_frames", 0),
        undated=counts.get("camera_undated", 0),
        unreadable=unreadable,
        refused={**refused, "unread": counts.get("unread", 0)},
    )
    return {"external_camera": figures}


def camera_texts(camera: CameraFigures | None) -> list[str]:
    """Return a sentence on what of an external camera was not used, and on what was used as it was."""
    if camera is None:
        return []
    texts = []
    refused = [f"{n} {_OF_CAMERAS[reason]}" for reason, n in camera.refused.items() if n]
    if refused:
        texts.append(f"not used of the messages of the external camera: {', '.join(refused)}")
    if camera.unreadable:
        texts.append(f"{camera.unreadable} frames of the external camera came whole and were no picture")
    if camera.undated:
        texts.append(
            f"{camera.undated} frames of the external camera had no usable timestamp: glass to glass begins with "
            "their arrival at the patient's host"
        )
    return texts


def is_foreign(logs: RunLogs) -> bool:
    """Tell whether another program was the surgeon, and ours only wrote its log."""
    return FOREIGN_SURGEON in counters_of(logs, "surgeon")


def device_texts(devices: ByHand, external_arms: ByHand) -> list[str]:
    """Return a sentence on each device and external arm that was silent, or sent what was not used."""
    texts = []
    for found, name in ((devices, "device of the {} hand"), (external_arms, "external arm of the {} hand")):
        for hand, row in found.items():
            whose = f"the {name.format(hand)}"
            if row.poses and row.silent_ticks:  # without any pose the run is invalid, and says so
                times = "once" if row.silences == 1 else f"{row.silences} times"
                how_long = f"{times}, for {row.silent_s:.1f} s in all"
                n = "one stretch" if row.silences == 1 else f"{row.silences} stretches"
                still = (
                    f"no pose of the {hand} hand came from a device or page in {n}, "
                    f"{row.silent_s:.1f} s in all: it was taken to stand still there; rest with poses is not counted"
                )
                texts.append(still if found is devices else f"{whose} was silent {how_long}: its last pose held")
            refused = [f"{n} {MEANING[reason]}" for reason, n in row.refused.items() if n]
            if refused:
                texts.append(f"not used of the messages of {whose}: {', '.join(refused)}")
    return texts


def _by_hand(logs: RunLogs, scenario: Scenario, side: Side, head: str) -> dict[Hand, DeviceFigures]:
    counts = counters_of(logs, side)
    rows = logs.of(side, DEVICES)
    found: dict[Hand, DeviceFigures] = {}
    for hand in scenario.source.hands:
        if f"{head}_poses.{hand}" not in counts:  # a foreign surgeon has its device to itself
            continue
        silent_ticks = counts.get(f"{head}_silent_ticks.{hand}", 0)
        first = [row["at_ns"] for row in rows if row["hand"] == hand and row["event"] == "first"]
        found[hand] = DeviceFigures(
            poses=counts.get(f"{head}_poses.{hand}", 0),
            first_s=first[0] / NS_PER_S if first else None,
            silences=counts.get(f"{head}_silences.{hand}", 0),
            silent_ticks=silent_ticks,
            silent_s=silent_ticks / scenario.rate_hz,
            refused={reason: counts.get(f"{head}_{reason}.{hand}", 0) for reason in get_args(Refusal)},
        )
    return found


def silent_camera(camera: CameraFigures | None) -> list[str]:
    """Return a problem where no frame of an external camera was used."""
    if camera is None or camera.frames:
        return []
    cure = "start the camera's program, or see external_camera in summary.json for why not"
    return [problem("external_camera: no frame came that could be used", cure)]


def silent_programs(devices: ByHand, external_arms: ByHand) -> list[str]:
    """Return a problem for each device and external arm of which no pose was used: nothing was measured."""
    names = {
        "devices": (devices, "the device", "nobody moved the hand: no pose came", _MOVE_IT),
        "external_arms": (external_arms, "the external arm", "no pose came from the external arm", _START_IT),
    }
    return [
        problem(f"{key}.{hand}: no pose came from {name} that could be used", f"{key} in summary.json says why not")
        if any(row.refused.values())
        else problem(f"{key}.{hand}: {nothing}", cure)
        for key, (found, name, nothing, cure) in names.items()
        for hand, row in found.items()
        if not row.poses
    ]


_MOVE_IT: Final = "drag in the picture of tis run --view, or start tis device in time"
_START_IT: Final = "start it before the run, on netem's east endpoint"
