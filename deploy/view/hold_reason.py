"""The reason why hold errs less than the estimate: one sentence, of what the page knows."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from tis.common.scenario import Scenario
from tis.common.sight.picture import scene_of
from tis.common.units import MM_PER_M
from tis.deploy.report.subjects.touch import loop_of
from tis.deploy.watch.live_figures import LiveFigures
from tis.patient_side.plant.environment import environment_of


@dataclass(frozen=True)
class RunAbout:
    """What the command that started the run tells its page about the scenario."""

    duration_s: float
    rate_hz: int
    active_estimator: str
    is_trained_on_synthetic: bool
    is_live: bool
    operator_n_m: float | None = None
    """Stiffness of the hand that would feel the forces, in N/m; None: the run has no touch."""
    wall_mm: Sequence[float] | None = None
    """A point of the surface that the arm touches, where the scenario alone tells it, and its normal."""
    wall_normal: Sequence[float] | None = None
    wall_n_m: float | None = None
    """Stiffness of what is touched, in N/m; None: it has no single one, or is not known here."""
    simulates_hand: bool = False
    """Whether a simulated hand yields to the forces."""
    loop: Sequence[Sequence[float]] | None = None
    """The fields of its `Limb` and of the `Arm`, where theory covers the loop."""
    has_picture: bool = False
    """Whether a camera's picture crosses the network."""
    picture: Sequence[Sequence[float]] | None = None
    """The directions right and up in the picture; None: unknown, as other cameras than ours may look anywhere."""


def about_of(scenario: Scenario) -> RunAbout:
    """Return what a page is told about a run's scenario."""
    touch, source, picture = scenario.touch, scenario.source, None
    if scenario.sight is not None and not scenario.sight.is_external:
        scene = scene_of(scenario)
        picture = scene.right, scene.up
    surface_m = wall_n_m = None
    if touch is not None and scenario.patient.plant.kind != "external":
        environment = environment_of(touch.environment)
        wall_n_m = touch.environment.stiffness_n_m if touch.environment.kind == "wall" else None
        if source.kind == "live":
            surface_m = environment.surface_m(source.arm_at_mm.of_m(source.hands[0]))
        else:
            surface_m = environment.place_m
    return RunAbout(
        scenario.duration_s,
        scenario.rate_hz,
        scenario.active_estimator,
        scenario.identification.train == "synthetic",
        source.kind == "live",
        None if touch is None else touch.operator.stiffness_n_m,
        None if surface_m is None else [MM_PER_M * value for value in surface_m],
        None if surface_m is None else environment.normal,
        wall_n_m,
        scenario.simulates_hand,
        loop_of(scenario),
        scenario.sight is not None,
        picture,
    )


_STILL_MM: Final = 1.0
_LONG_MS: Final = 500.0
_YOUNG_MS: Final = 40.0


def why_hold(found: LiveFigures, about: RunAbout | None) -> str:
    """Return why hold's error is below the estimate's over the last seconds; "" where it is not.

    Oracle: figures of one cause each, tests/deploy/view/test_hold_reason.
    """
    if about is not None and about.active_estimator == "hold":
        return "The patient's estimate is hold in this run: it repeats the newest position, and predicts nothing."
    if found.rmse_mm is None or found.hold_rmse_mm is None or found.rmse_mm <= found.hold_rmse_mm:
        return ""
    hold, estimate = f"{found.hold_rmse_mm:.2f} mm", f"{found.rmse_mm:.2f} mm"
    if hold == estimate:  # what is not seen needs no reason
        return ""
    begin = f"Hold errs less now ({hold}, the estimate {estimate})"
    if found.extent_mm is not None and found.extent_mm < _STILL_MM:
        return f"{begin}: the hand rests, so the newest position is right however old it is."
    if found.gap_max_ms is not None and found.gap_max_ms > _LONG_MS:
        return f"{begin}: nothing newer arrived for up to {found.gap_max_ms:.0f} ms, too long to predict over."
    if found.age_max_ms is not None and found.age_max_ms > _LONG_MS:
        return f"{begin}: the newest position was up to {found.age_max_ms:.0f} ms old, too long to predict over."
    if found.age_max_ms is not None and found.age_max_ms < _YOUNG_MS:
        return f"{begin}: the newest position is at most {found.age_max_ms:.0f} ms old: there is little to predict."
    if about is not None and about.is_trained_on_synthetic and about.is_live:
        return f"{begin}: the filter's model was identified on synthetic movement, and has never seen this hand."
    return f"{begin}. Nothing that this page sees tells why."
