"""The movement of live devices: at sample k, the newest poses that arrived at or before its instant."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, get_args

from tis.common.channels import FOLLOWER, Hand, HandChannels, hand_channels
from tis.common.devices.gate import DeviceGate, from_json, from_ros2
from tis.common.devices.records import DEVICES, DeviceEvent, DeviceNote, Refusal
from tis.common.node import Arrival, Record
from tis.common.scenario.live_source import LiveSource
from tis.common.units import NS_PER_S, ms_to_ns
from tis.common.zenoh_syntax import key_matches
from tis.surgeon_side.live.mapping import Mapping as DeviceMapping
from tis.surgeon_side.motion import HandPoses

_DECODERS: Final = {"json": from_json, "ros2": from_ros2}


@dataclass
class _Device:
    """The device of one hand, and what was told about it."""

    hand: Hand
    key: str
    gate: DeviceGate
    mapping: DeviceMapping
    heard_ns: int = 0
    is_silent: bool = False
    n_silences: int = 0
    n_silent_ticks: int = 0


class LiveMotion:
    """Follows one device for each hand; a device that is silent holds its last pose, and that is logged.

    Until its first pose a hand rests in its place. Truth is known with each sample, none ahead. Oracle: arrivals with
    literal instants, tests/surgeon_side/live/test_motion.
    """

    def __init__(self, source: LiveSource, rate_hz: int) -> None:
        self._silent_ns = ms_to_ns(source.silent_after_ms)
        self._period_ns = NS_PER_S // rate_hz
        self.channels: Sequence[HandChannels] = [hand_channels(hand, FOLLOWER[hand]) for hand in source.hands]
        self._devices = [
            _Device(
                hand,
                source.keys.of(hand),
                DeviceGate(_DECODERS[source.encoding], self._silent_ns),
                DeviceMapping(source, hand),
            )
            for hand in source.hands
        ]
        self._told: set[tuple[Hand, Refusal]] = set()
        self._advanced = -1

    def listens(self) -> Sequence[str]:
        """Return the keys of the devices."""
        return [device.key for device in self._devices]

    def take(self, arrival: Arrival) -> None:
        """Keep a device's message for the next sample."""
        for device in self._devices:
            if key_matches(device.key, arrival.key):
                device.gate.take(arrival.recv_ns, arrival.payload)

    def advance(self, k: int, t_ns: int) -> Sequence[Record]:
        """Follow the poses that have arrived, and return notes about devices that began, fell silent or came back."""
        self._advanced = k
        return [note for device in self._devices for note in self._follow(device, t_ns)]

    def poses(self, k: int) -> Sequence[HandPoses]:  # noqa: ARG002  (the last one advanced to)
        """Return where masters and commanded arms are now."""
        return [device.mapping.poses() for device in self._devices]

    def truth(self, k: int, is_first: bool) -> Iterator[tuple[int, Sequence[HandPoses]]]:  # noqa: ARG002
        """Yield sample ``k``; nothing for a missed one, at which nobody knows where the device was."""
        if k == self._advanced:
            yield k, self.poses(k)

    def counters(self) -> Mapping[str, int]:
        """Return for each hand the numbers of used poses, of refused messages by reason, and of silences."""
        found: dict[str, int] = {}
        for device in self._devices:
            refused = {**device.gate.refusals, "jump": device.mapping.n_jumps}
            found[f"device_poses.{device.hand}"] = device.gate.n_poses
            found |= {f"device_{reason}.{device.hand}": refused.get(reason, 0) for reason in get_args(Refusal)}
            found[f"device_silences.{device.hand}"] = device.n_silences
            found[f"device_silent_ticks.{device.hand}"] = device.n_silent_ticks
        return found

    def _follow(self, device: _Device, t_ns: int) -> Iterator[Record]:
        samples = device.gate.drain()
        had_begun, n_jumps = device.mapping.has_begun, device.mapping.n_jumps
        if samples:
            device.mapping.move(samples, t_ns, self._period_ns)
            silent_for_ns = t_ns - device.heard_ns
            if not had_begun:
                yield _note(device, t_ns, "first", 0)
            elif device.is_silent:
                yield _note(device, t_ns, "back", silent_for_ns)
            device.heard_ns, device.is_silent = samples[-1].recv_ns, False
        elif t_ns - device.heard_ns > self._silent_ns:
            device.n_silent_ticks += 1
            if not device.is_silent:
                device.is_silent = True
                device.n_silences += 1
                yield _note(device, t_ns, "silent", t_ns - device.heard_ns)
        reasons = [*device.gate.refusals, *(["jump"] if device.mapping.n_jumps > n_jumps else [])]
        for reason in get_args(Refusal):
            if reason in reasons and (device.hand, reason) not in self._told:
                self._told.add((device.hand, reason))
                yield _note(device, t_ns, "refused", 0, reason)


def _note(device: _Device, t_ns: int, event: DeviceEvent, for_ns: int, reason: str = "") -> Record:
    note = DeviceNote(at_ns=t_ns, hand=device.hand, event=event, for_ns=for_ns, reason=reason)
    return Record(DEVICES, t_ns, note)
