"""The recorded arm, which repeats its movement."""

from dataclasses import dataclass

from tis.common.units import NS_PER_S, sample_instant_ns
from tis.patient_side.plant.protocol import PlantOutput, Reference
from tis.patient_side.rotations import turned, turned_by
from tis.patient_side.statespace import Array


@dataclass(frozen=True)
class ReplayPlant:
    """The arm follows the recorded arm: positions (N, 3) in m at the sample instants of ``rate_hz``.

    ``orientation`` (N, 4) and ``gripper_rad`` (N,), where they are known, are interpolated likewise, the orientation
    at a constant rotation speed. A tick reads two rows, however long the recording is. Oracles: numpy's
    interpolation, SciPy's Slerp.
    """

    recorded_m: Array
    rate_hz: int
    orientation: Array | None = None
    gripper_rad: Array | None = None

    def initial(self) -> None:
        """Return the state: there is none."""

    def step(
        self,
        state: None,  # noqa: ARG002  part of the protocol; a recording needs none of these
        reference: Reference | None,  # noqa: ARG002
        tick: int,  # noqa: ARG002
        now_ns: int,
    ) -> tuple[None, PlantOutput]:
        """Return the recorded arm, interpolated linearly and constant beyond its ends."""
        at = max(((now_ns + 1) * self.rate_hz - 1) // NS_PER_S, 0)
        orientation, gripper_rad = self.orientation, self.gripper_rad
        if at >= len(self.recorded_m) - 1:
            position = self.recorded_m[-1]
            turned_to = None if orientation is None else orientation[-1]
            angle_rad = None if gripper_rad is None else float(gripper_rad[-1])
            return None, PlantOutput(position, position, turned_to, angle_rad)
        here, there = self.recorded_m[at], self.recorded_m[at + 1]
        begun_ns = sample_instant_ns(at, self.rate_hz)
        period_ns, since_ns = sample_instant_ns(at + 1, self.rate_hz) - begun_ns, max(now_ns - begun_ns, 0)
        speed = (there - here) / period_ns
        position = speed * since_ns + here
        share = since_ns / period_ns
        turned_to = angle_rad = None
        if orientation is not None:
            turned_to = turned_by(orientation[at], share * turned(orientation[at], orientation[at + 1]))
        if gripper_rad is not None:
            angle_rad = float((1.0 - share) * gripper_rad[at] + share * gripper_rad[at + 1])
        return None, PlantOutput(position, position, turned_to, angle_rad)
