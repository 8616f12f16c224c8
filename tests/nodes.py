"""Nodes and messages that several tests need."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from tis.common.channels import Network, hand_channels
from tis.common.messages import Header, Pose, Quaternion, Vector3, encode
from tis.common.node import Arrival, Emission, Output, Record
from tis.common.sources.trajectory import HandRecording, PoseTrack, Recording

LEFT = hand_channels("left", "PSM2")


class Stamp(NamedTuple):
    """The packet's number on its key, when its sample was taken and when it was sent."""

    seq: int
    sample_ns: int
    sent_ns: int


def a_pose(x: float = 0.0, y: float = 0.0, z: float = 0.0, sample_ns: int = 0) -> Pose:
    level = Quaternion(x=0, y=0, z=0, w=1)
    return Pose(sample_ns=sample_ns, position_m=Vector3(x=x, y=y, z=z), orientation=level, gripper_rad=0.5)


def an_arrival(
    key: str, recv_ns: int, stamp: Stamp | bytes, pose: Pose | bytes, network: Network = "east"
) -> Arrival:
    attachment = Header(stamp.seq, stamp.sent_ns).pack() if isinstance(stamp, Stamp) else stamp
    if isinstance(pose, Pose):
        stamped = replace(pose, sample_ns=stamp.sample_ns) if isinstance(stamp, Stamp) else pose
        payload = encode(stamped)
    else:
        payload = pose
    return Arrival(network, key, payload, attachment, recv_ns)


def a_recording(n_rows: int = 200, start: int = 0, rate_hz: int = 30) -> Recording:
    """A smooth movement whose arm is half the master plus an offset."""
    t = np.arange(n_rows) / rate_hz
    master = 0.05 * np.column_stack([np.sin(2 * t), np.cos(1.3 * t), np.sin(0.7 * t + 1)])
    level = np.tile([0.0, 0.0, 0.0, 1.0], (n_rows, 1))
    command = PoseTrack(master, level, np.zeros(n_rows))
    follower = PoseTrack(0.5 * master + [0.1, 0.0, -0.1], level, np.zeros(n_rows))
    return Recording("a test movement", rate_hz, (HandRecording("left", "PSM2", command, follower),), start, "cross")


@dataclass
class Metronome:
    """Sends its tick number at fixed instants; remembers what it hears."""

    name: str
    period_ns: int
    n_ticks: int
    listening: Sequence[tuple[Network, str]] = ()
    network: Network = "west"
    key: str = "t/tick"
    k: int = 0
    woken_ns: list[int] = field(default_factory=list)
    heard: list[tuple[int, bytes]] = field(default_factory=list)
    finished_ns: int | None = None

    def listens(self) -> Sequence[tuple[Network, str]]:
        return self.listening

    def publishes(self) -> Sequence[tuple[Network, str]]:
        return [(self.network, self.key)]

    def receive(self, arrival: Arrival) -> Sequence[Output]:
        self.heard.append((arrival.recv_ns, arrival.payload))
        return []

    def wake(self, now_ns: int) -> Sequence[Output]:
        self.woken_ns.append(now_ns)
        k, self.k = self.k, self.k + 1
        return [Emission(self.network, self.key, str(k).encode(), Header(k), lambda _: ())]

    def next_wake_ns(self) -> int | None:
        return self.k * self.period_ns if self.k < self.n_ticks else None

    def finish(self, now_ns: int) -> Sequence[Record]:
        self.finished_ns = now_ns
        return []

    def counters(self) -> dict[str, int]:
        return {"ticks": self.k}


class Shelf:
    """A recorder that keeps its records in memory."""

    def __init__(self) -> None:
        self.records: list[Record] = []

    def record(self, record: Record) -> None:
        self.records.append(record)

    def on(self, topic: str) -> list[Record]:
        return [record for record in self.records if record.topic == topic]
