"""The patient's side of a scenario: its ticks, its plant, and the methods for orientation and gripper."""

from math import pi
from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator

from tis.common.scenario.base import Milliseconds, NonNegative, Part, Positive, distinct
from tis.common.scenario.safety import Gate, Safety
from tis.common.units import MM_PER_M

OrientationMethod = Literal["hold", "tangent_ls"]


class Orientation(Part):
    """Estimation of the arm's orientation and of its gripper's angle; the position estimators do not depend on it."""

    methods: Annotated[tuple[OrientationMethod, ...], Field(min_length=1), distinct("method")] = Field(
        ("hold", "tangent_ls"),
        description="Methods that run side by side; hold always runs. hold: orientation and gripper of the newest "
        "sample; tangent_ls: least squares on the past, a regression for each horizon, in the "
        "tangent space at the newest orientation.",
    )
    active: OrientationMethod = Field(
        "tangent_ls", description="The method whose orientation and gripper the answers and set points carry."
    )

    @model_validator(mode="after")
    def _runs(self) -> Self:
        if self.active not in (*self.methods, "hold"):
            raise ValueError("active must be one of methods, or hold")
        return self

    @property
    def in_order(self) -> tuple[OrientationMethod, ...]:
        """Return the methods that run, the active one first."""
        return tuple(dict.fromkeys((self.active, *self.methods, "hold")))


STEPS_A_RADIAN: Final = 3
"""Least number of physics steps in 1 / (2 pi) of the position loop's period, so that the loop stays stable."""


class MujocoPlant(Part):
    """An arm with the joints of a da Vinci instrument arm that executes the set points, simulated by MuJoCo."""

    kind: Literal["mujoco"] = Field(
        description="mujoco: a simulated arm with joints, driven by the set points through its inverse kinematics; "
        "needs the extra sim on the patient's host."
    )
    bandwidth_hz: Positive = Field(
        10.0, le=100, description="Natural frequency of each joint's position loop at the home pose, in Hz."
    )
    damping: Positive = Field(1.0, le=10, description="Damping ratio of the position loops; 1: critically damped.")
    physics_hz: int = Field(500, ge=100, le=5000, strict=True, description="Rate of the physics, in Hz.")
    friction: NonNegative = Field(
        1.0, le=10, description="Friction of the joints, as a multiple of that of the model; 0: none."
    )
    encoder_noise_mrad: NonNegative = Field(
        0.0, le=50, description="Standard deviation of the noise on each measured joint angle, in mrad."
    )
    encoder_noise_mm: NonNegative = Field(
        0.0, le=10, description="Standard deviation of the noise on the measured insertion, in mm."
    )
    insertion_mm: float = Field(
        120.0,
        ge=50,
        le=200,
        description="Insertion of the instrument at the first set point, which becomes the arm's home, in mm.",
    )

    @model_validator(mode="after")
    def _stable(self) -> Self:
        most_hz = self.physics_hz / (2.0 * pi * STEPS_A_RADIAN)
        if self.bandwidth_hz > most_hz:
            raise ValueError(f"bandwidth_hz must be at most {most_hz:.1f} at this physics_hz")
        return self

    @property
    def insertion_m(self) -> float:
        """`insertion_mm` in m."""
        return self.insertion_mm / MM_PER_M


class ReplayPlant(Part):
    """An arm that repeats the recorded movement, for feedback only; the estimators never receive it."""

    kind: Literal["replay"] = Field(description="replay: the arm repeats its recorded movement.")


class ServoPlant(Part):
    """An arm that follows the active estimate as a second-order servo, the same on each axis."""

    kind: Literal["servo"] = Field(description="servo: the arm follows the active estimate.")
    bandwidth_hz: Positive = Field(10.0, le=1000, description="Natural frequency of the servo, in Hz.")
    damping: Positive = Field(1.0, le=10, description="Damping ratio of the servo; 1: critically damped.")
    sensor_noise_mm: NonNegative = Field(
        0.0, description="Standard deviation of the noise on the measured position, in mm, per axis."
    )
    mass_kg: float | None = Field(
        None, ge=0.05, le=100, description="Mass that what it touches pushes, in kg. Not given, with touch: 0.3."
    )

    @property
    def moved_mass_kg(self) -> float:
        """`mass_kg` with its default."""
        return 0.3 if self.mass_kg is None else self.mass_kg


class ExternalPlant(Part):
    """A simulator or robot of its own, which joins by Zenoh keys of the patient's network.

    It follows ``<session>/PSM2/servo_cp`` and publishes where it is on ``<session>/PSM2/arm/measured_cp``.
    """

    kind: Literal["external"] = Field(description="external: an arm that another program moves.")
    silent_after_ms: Annotated[Milliseconds, Field(gt=0)] = Field(
        500.0,
        description="Time without a pose after which the arm counts as silent, in ms. Its last pose stays in force, "
        "and the run's report says so.",
    )


TickMode = Literal["free", "phase_locked", "on_arrival"]

Plant = Annotated[ReplayPlant | ServoPlant | ExternalPlant | MujocoPlant, Field(discriminator="kind")]


class PatientPart(Part):
    """The patient's side."""

    tick: TickMode = Field(
        "free",
        description="Instants at which the patient estimates. free: ticks at rate_hz, with a constant phase; "
        "phase_locked: their phase follows the usual arrival of samples; on_arrival: as free, and the active "
        "estimator also answers when a fresher sample arrives.",
    )
    tick_phase_ms: NonNegative = Field(
        2.0,
        description="Offset of the ticks from the sample instants, in ms; for phase_locked the initial one. With 0 "
        "and a delay of whole periods, chance decides whether an arrival precedes its tick.",
    )
    plant: Plant = Field(ReplayPlant(kind="replay"), description="Arm on the patient's side.")
    orientation: Orientation = Field(
        Orientation(), description="Estimation of the arm's orientation and of its gripper's angle."
    )
    gate: Gate = Field(Gate(), description="Limits of the samples that the patient uses.")
    safety: Safety = Field(Safety(), description="Limits of the set point that drives the arm.")
