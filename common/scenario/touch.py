"""Touch: what the arm touches, the hand that feels it, and how forces and movements are coupled and sent."""

from math import isfinite, sqrt
from typing import Annotated, Final, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from tis.common.scenario.base import Milliseconds, NonNegative, Part, Positive
from tis.common.scenario.patient import PatientPart
from tis.common.scenario.surgeon import SurgeonPart

LEAST_NORMAL: Final = 1e-6

PositiveMs = Annotated[Milliseconds, Field(gt=0)]
Millimetres = Annotated[float, Field(ge=-1000, le=1000)]
Triple = tuple[float, float, float]


def _direction(value: Triple) -> Triple:
    """Return the vector; raises `ValueError` where it has no direction."""
    length = sqrt(sum(one * one for one in value))
    if not LEAST_NORMAL <= length <= 1.0 / LEAST_NORMAL or not isfinite(length):
        raise ValueError("must be a vector with a direction, like [0, 0, 1]")
    return value


class AnyEnvironment(Part):
    """A plane, and the material behind it. It does not move."""

    normal: Annotated[Triple, AfterValidator(_direction)] = Field(
        (0.0, 0.0, 1.0), description="Direction out of the material; of any length."
    )
    distance_mm: Millimetres | None = Field(
        None,
        description="Distance from the arm's first set point to the plane, against the normal, in mm; negative: the "
        "arm begins in the material. For an arm that is started anew it is found anew; that of position_mm stays. "
        "Neither given: 5.",
    )
    position_mm: tuple[Millimetres, Millimetres, Millimetres] | None = Field(
        None, description="A point of the plane in the frame of the arm's positions, in mm, instead of distance_mm."
    )

    @model_validator(mode="after")
    def _lies_somewhere(self) -> Self:
        if self.distance_mm is not None and self.position_mm is not None:
            raise ValueError("distance_mm and position_mm exclude each other")
        return self

    @property
    def distance_m(self) -> float:
        """`distance_mm` in m, with its default."""
        return (5.0 if self.distance_mm is None else self.distance_mm) / 1000.0


class WallEnvironment(AnyEnvironment):
    """A wall: a spring and a damper that push and never pull."""

    kind: Literal["wall"] = Field(description="wall: a spring with a damper behind the plane.")
    stiffness_n_m: float = Field(
        400.0,
        ge=1,
        le=20_000,
        description="Stiffness, in N/m; 1 N/mm is 1000. Tissue has some hundred, a hard wall several thousand.",
    )
    damping_ns_m: NonNegative = Field(0.0, le=100, description="Damping, in N s/m.")


class TissueEnvironment(AnyEnvironment):
    """Soft tissue that a round tip presses: Hertz's contact with the damping of Hunt and Crossley."""

    kind: Literal["tissue"] = Field(description="tissue: soft tissue under a round tip.")
    shear_modulus_kpa: Positive = Field(
        1.8, le=1000, description="Shear modulus, in kPa: of liver 1.8, of a tumour in it 23.4."
    )
    tip_radius_mm: Positive = Field(4.0, le=50, description="Radius of the tip, in mm.")
    poisson_ratio: float = Field(0.5, ge=0, le=0.5, description="Poisson's ratio; 0.5: incompressible.")
    loss_s_m: NonNegative = Field(
        0.5, le=10, description="Coefficient c of the damping: force times (1 + 1.5 c speed), in s/m."
    )


Environment = Annotated[WallEnvironment | TissueEnvironment, Field(discriminator="kind")]


class OperatorPart(Part):
    """The simulated hand that holds a device, and yields to the force that it feels.

    Published hands: 0.8 kg, 5.5 N s/m, 568 N/m (after Hogan 1989); 2 kg, 2 N s/m, 10 N/m (after Yokokohji 1994).
    """

    mass_kg: float = Field(0.8, ge=0.01, le=100, description="Mass of the hand, in kg.")
    damping_ns_m: Positive = Field(5.5, le=1000, description="Damping of the hand, in N s/m.")
    stiffness_n_m: float = Field(
        568.0, ge=1, le=1e5, description="Stiffness that holds the hand at what it intends, in N/m."
    )
    device_mass_kg: NonNegative = Field(0.1, le=100, description="Mass of the device, in kg.")
    device_damping_ns_m: NonNegative = Field(0.5, le=1000, description="Friction of the device, in N s/m.")

    @property
    def with_device(self) -> Triple:
        """Mass in kg, damping in N s/m and stiffness in N/m of hand and device together."""
        return self.mass_kg + self.device_mass_kg, self.damping_ns_m + self.device_damping_ns_m, self.stiffness_n_m


CouplingKind = Literal["position_force", "wave", "tdpa"]


class Deadbands(Part):
    """Weber's deadbands: a change smaller than this share is not sent. 0: everything is sent."""

    force: float = Field(0.0, ge=0, le=1, description="Share of the force, 0 to 1; 0.05 to 0.2 are usual.")
    motion: float = Field(0.0, ge=0, le=1, description="Share of the hand's velocity, 0 to 1.")
    keep_alive_ms: PositiveMs | None = Field(
        50.0, description="Time after which a sample is sent in any case, in ms; null: never."
    )


class TouchPart(Part):
    """The arm touches something, and the hand feels it."""

    environment: Environment = Field(
        WallEnvironment(kind="wall"), description="What the arms touch; an external arm tells its force itself."
    )
    operator: OperatorPart = Field(OperatorPart(), description="The simulated hand that feels.")
    live_hand: Literal["own", "simulated"] = Field(
        "own",
        description="Hand that feels with a live source. own: that of the person at a device which shows forces; "
        "simulated: operator, and the device, such as a pointer, tells what it intends.",
    )
    coupling: CouplingKind = Field(
        "position_force",
        description="position_force: the measured force is shown as it arrives, the estimate drives the arm; wave: "
        "wave variables, passive at any delay; tdpa: time-domain passivity control with two ports.",
    )
    impedance_ns_m: Positive = Field(20.0, le=1000, description="Impedance b of wave variables, in N s/m.")
    deadband: Deadbands = Field(Deadbands(), description="Which forces and movements are not sent.")
    force_max_n: Positive = Field(20.0, le=1000, description="Largest force that is shown to the hand, in N.")
    power_max_w: Positive = Field(
        20.0, le=10_000, description="Power beyond which no received wave or energy is believed, in W."
    )
    fade_after_ms: PositiveMs = Field(
        100.0,
        description="Age of the newest force at which the hand feels none any more, in ms; it fades from half of it "
        "on. The round trip must be shorter.",
    )
    contact_stop_n: Positive | None = Field(
        None,
        le=1000,
        description="Force on the arm beyond which it slowly stops, and then only retreats, in N; not given: none.",
    )

    @model_validator(mode="after")
    def _fits(self) -> Self:
        broken = []
        keep_ms = self.deadband.keep_alive_ms
        if self.coupling == "wave" and (self.deadband.force or self.deadband.motion):
            broken.append("deadband must be 0 with coupling wave: a wave that is not sent would be a lost one")
        if (self.deadband.force or self.deadband.motion) and keep_ms and 2 * keep_ms > self.fade_after_ms:
            broken.append("deadband.keep_alive_ms must be at most half of fade_after_ms, or a constant force fades")
        if broken:
            raise ValueError("\n".join(broken))
        return self


def touch_rules(touch: TouchPart | None, patient: PatientPart, surgeon: SurgeonPart, rate_hz: int) -> dict[str, bool]:
    """Return the rules between touch and other parts of a scenario, each with whether it holds."""
    if touch is None:
        return {}
    kind, period_ms = patient.plant.kind, 1000.0 / rate_hz
    hold_ms = min(patient.safety.hold_age_ms, patient.safety.break_ms)
    keep_ms = touch.deadband.keep_alive_ms
    return {
        f"patient.plant.kind must be servo, mujoco or external with touch: a replayed arm meets nothing ({kind})": (
            kind != "replay"
        ),
        f"patient.plant.kind must be servo with touch.coupling {touch.coupling}, which needs the arm's spring "
        f"({kind})": touch.coupling == "position_force" or kind not in ("mujoco", "external"),
        f"patient.tick must not be on_arrival with touch.coupling {touch.coupling}, which follows no estimate": (
            touch.coupling == "position_force" or patient.tick != "on_arrival"
        ),
        f"touch.fade_after_ms must be at least four periods of rate_hz ({4 * period_ms:g})": (
            touch.fade_after_ms >= 4 * period_ms
        ),
        "touch.deadband.keep_alive_ms must be at most half of hold_age_ms and break_ms of patient.safety "
        f"({hold_ms:g}), or a still hand would hold the arm": (
            not touch.deadband.motion or keep_ms is None or 2 * keep_ms <= hold_ms
        ),
        "surgeon.copies must be 1 with touch.deadband.motion: a sample that is kept back has no copies": (
            not touch.deadband.motion or surgeon.copies == 1
        ),
    }
