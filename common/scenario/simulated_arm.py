"""The arm that MuJoCo simulates: its position loop, physics and sensors."""

from math import pi
from typing import Final, Literal, Self

from pydantic import Field, model_validator

from tis.common.scenario.base import NonNegative, Part, Positive
from tis.common.units import MM_PER_M

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
