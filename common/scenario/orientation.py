"""Methods for the arm's orientation and its gripper, which run beside the position estimators."""

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from tis.common.scenario.base import Part

OrientationMethod = Literal["hold", "constant_rate", "tangent_ls"]


def _each_once(methods: tuple[OrientationMethod, ...]) -> tuple[OrientationMethod, ...]:
    if len(set(methods)) != len(methods):
        raise ValueError("must name each method at most once")
    return methods


class Orientation(Part):
    """Estimation of the arm's orientation and of its gripper's angle; the position estimators do not depend on it."""

    methods: Annotated[
        tuple[OrientationMethod, ...],
        Field(min_length=1),
        AfterValidator(_each_once),
    ] = Field(
        ("hold", "constant_rate", "tangent_ls"),
        description="Methods that run side by side; hold always runs. hold: orientation and gripper of the newest "
        "sample; constant_rate: they go on at their last rate, which is damped; tangent_ls: least squares on the "
        "past, a regression for each horizon, in the tangent space at the newest orientation.",
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
