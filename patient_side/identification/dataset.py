"""Training trials from recordings: positions, three in and three out, about an operating point.

Velocity columns of recordings look ahead in time, so only positions are read by default; with ``velocities`` the
commanded velocities are inputs four to six.
"""

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import Final, Literal

import numpy as np

from tis.common.channels import Arm, Hand
from tis.common.errors import DataError, Fault
from tis.common.scenario import Scenario
from tis.common.sources.plausibility import stretches
from tis.common.sources.trajectory import HandRecording, Recording
from tis.common.units import NS_PER_S
from tis.patient_side.identification.trials import Trial, finite_faults
from tis.patient_side.linear_system import Array
from tis.patient_side.safety.gate import BASE_NS
from tis.patient_side.safety.limits import Three
from tis.patient_side.statespace import Movement

# Reach, speed and acceleration of the positions of training rows, from which limits of a run follow.

_SHARE: Final = 0.999
"""Share of the rows that count: a jump of a recorder is no movement."""


def movement_of(positions_m: Sequence[Array], offset_m: Array, rate_hz: int) -> Movement:
    """Return the movement of trials' positions (N, 3) about ``offset_m``, at ``rate_hz`` rows per second.

    Velocities are over the time of the gate, which measures the samples of a run. Oracle: a circle and a jump,
    test_movement.
    """
    rows = max(1, round(BASE_NS * rate_hz / NS_PER_S))
    speeds, changes = [], []
    for position_m in positions_m:
        velocity = (position_m[rows:] - position_m[:-rows]) * (rate_hz / rows)
        speeds.append(np.linalg.norm(velocity, axis=1))
        changes.append(np.linalg.norm(velocity[rows:] - velocity[:-rows], axis=1) * (rate_hz / rows))
    reaches = [np.linalg.norm(position_m - offset_m, axis=1) for position_m in positions_m]
    return Movement(*(_most(parts) for parts in (reaches, speeds, changes)))


def trained(scenario: Scenario, movement: Movement | None) -> Three | None:
    """Return the movement of training rows from which limits of a run follow; None unless it plays a table.

    An arm outside the testbed keeps the usual limits until a person gives others: a table says nothing of its room.
    """
    is_played = scenario.source.kind == "table" and scenario.patient.plant.kind != "external"
    return astuple(movement) if is_played and movement else None


def _most(parts: Sequence[Array]) -> float:
    values = np.concatenate(parts)
    return float(np.quantile(values, _SHARE, method="lower")) if len(values) else 0.0


@dataclass(frozen=True)
class TrainingSet:
    """Labelled trials about an operating point, that point, and the range of the modelled hand.

    About the mean, each trial is centred on its own mean, since positions differ from set-up to set-up. The offsets
    (3,) are the means over all rows of the hand: with one trial the operating point itself, with several a first
    guess, from which a run differs by a constant that an estimator has to absorb (a bias state). About the lowest
    value, all trials share one offset, the lower end of their common range. ``grippers_rad`` (N,) are the angles of
    the arms' grippers, ``orientations`` (N, 4) the arms' unit quaternions x, y, z, w, and ``others`` (N, 4) the
    ways from the arms to the other hand's and the angles of its gripper, NaN without one, trial by trial; ``people``
    is who moves in each, empty where that is not known.

    A recording with jumps is several trials, the stretches between them: what jumped may be the origin itself.
    ``first_rows`` are the recordings' rows at which the trials begin; ``warnings`` name the recordings that were cut.
    """

    trials: tuple[Trial, ...]
    grippers_rad: tuple[Array, ...]
    orientations: tuple[Array, ...]
    others: tuple[Array, ...]
    people: tuple[str, ...]
    labels: tuple[str, ...]
    arm: Arm
    rate_hz: int
    input_offset_m: Array
    output_offset_m: Array
    output_low_m: Array
    output_high_m: Array
    first_rows: tuple[int, ...]
    warnings: tuple[str, ...]

    @property
    def commands(self) -> list[Array]:
        """The commanded positions (N, 3) about the operating point."""
        return [u[:, :3] for u, _ in self.trials]


@dataclass(frozen=True)
class _Stretch:
    """One hand's rows of a recording from ``first_row`` on, without a jump."""

    label: str
    person: str
    part: HandRecording
    first_row: int
    others: Array


def training_set(
    recordings: Sequence[Recording],
    hand: Hand,
    *,
    pool_hands: bool,
    about: Literal["mean", "lowest"] = "mean",
    velocities: bool = False,
    shortest: int = 1,
) -> TrainingSet:
    """Return the trials of ``hand``, or of every hand when ``pool_hands``; raises `DataError`.

    The means and the range always come from ``hand`` alone, as the two arms work in different places. Of a recording
    with jumps, stretches of fewer than ``shortest`` rows are left out; `DataError` where no other is left.
    """
    _check(recordings, hand, pool_hands, velocities)
    kept, warnings = _between_jumps(recordings, shortest)
    own = [each for each in kept if each.part.hand == hand]
    if not own:
        rule = f"need {shortest} rows between jumps: {'; '.join(warnings)}"
        raise DataError(Fault("identification", "training rows", rule))
    chosen = kept if pool_hands else own
    signals = [_signals(each.part, velocities) for each in chosen]
    inputs = np.concatenate([each.part.command.position_m for each in own])
    outputs = np.concatenate([each.part.follower.position_m for each in own])
    if about == "mean":
        input_offset_m, output_offset_m = inputs.mean(axis=0), outputs.mean(axis=0)
        trials = tuple(_centred(u, y) for u, y in signals)
    else:
        lowest = np.min([u.min(axis=0) for u, _ in signals], axis=0)
        input_offset_m = lowest[:3]
        output_offset_m = np.min([y.min(axis=0) for _, y in signals], axis=0)
        trials = tuple((u - lowest, y - output_offset_m) for u, y in signals)
    return TrainingSet(
        trials=trials,
        grippers_rad=tuple(each.part.follower.gripper_rad for each in chosen),
        orientations=tuple(each.part.follower.orientation for each in chosen),
        others=tuple(each.others for each in chosen),
        people=tuple(each.person for each in chosen),
        labels=tuple(each.label for each in chosen),
        arm=own[0].part.arm,
        rate_hz=recordings[0].rate_hz,
        input_offset_m=input_offset_m,
        output_offset_m=output_offset_m,
        output_low_m=outputs.min(axis=0),
        output_high_m=outputs.max(axis=0),
        first_rows=tuple(each.first_row for each in chosen),
        warnings=tuple(warnings),
    )


def _between_jumps(recordings: Sequence[Recording], shortest: int) -> tuple[list[_Stretch], list[str]]:
    """Return the stretches of all hands without a jump, and a sentence on each recording that was cut."""
    kept, warnings = [], []
    for recording in recordings:
        found = stretches(recording)
        long = found if len(found) == 1 else [each for each in found if each[1] - each[0] >= shortest]
        if len(found) > 1:
            short = [each for each in found if each not in long]
            left_out = f"; left out, as shorter than {shortest} rows: {_named(short)}" if short else ""
            apart = f"{_named(long)}, as trials of their own" if long else "no rows"
            warnings.append(f"{recording.label}: trained on {apart}, and not on the jumps between{left_out}")
        for part in recording.hands:
            others = _others(recording, part)
            for first, stop in long:
                rows = f" rows {first}-{stop - 1}" if len(found) > 1 else ""
                label = f"{recording.label}{rows}, {part.hand} hand"
                kept.append(_Stretch(label, recording.person, part.rows(first, stop), first, others[first:stop]))
    return kept, warnings


def _others(recording: Recording, part: HandRecording) -> Array:
    """Return the ways from a hand's arm to the other hand's, and its gripper's angles (N, 4); NaN without one."""
    own_m = part.follower.position_m
    found = np.full((len(own_m), 4), np.nan)
    for other in recording.hands:
        if other.hand != part.hand:
            there = other.follower
            n = min(len(own_m), len(there.position_m))
            found[:n, :3], found[:n, 3] = there.position_m[:n] - own_m[:n], there.gripper_rad[:n]
    return found


def _named(found: Sequence[tuple[int, int]]) -> str:
    return ", ".join(f"rows {first}-{stop - 1}" for first, stop in found)


def _check(recordings: Sequence[Recording], hand: Hand, pool_hands: bool, velocities: bool) -> None:
    parts = [part for recording in recordings for part in recording.hands if part.hand == hand]
    if not parts:
        raise DataError(Fault("identification", "training", f"no recording holds the {hand} hand"))
    faults = []
    rates = sorted({recording.rate_hz for recording in recordings})
    if len(rates) > 1:
        faults.append(Fault("identification", "rate_hz", "must be the same in all training recordings", rates))
    arms = sorted({part.arm for part in parts})
    if len(arms) > 1:
        rule = f"the {hand} hand must drive the same arm in all training recordings"
        faults.append(Fault("identification", "pairing", rule, arms))
    if velocities and any(part.command_velocity_m_s is None for r in recordings for part in r.hands):
        faults.append(Fault("identification", "inputs", "must be position: this source has no velocity columns"))
    # Checked before centring: a mean would spread one NaN over its whole column.
    faults = faults or [
        fault
        for recording in recordings
        for part in recording.hands
        if pool_hands or part.hand == hand
        for fault in finite_faults(f"{recording.label}, {part.hand} hand", *_signals(part, velocities))
    ]
    if faults:
        raise DataError(faults)


def _signals(part: HandRecording, velocities: bool) -> Trial:
    u, y = part.command.position_m, part.follower.position_m
    if velocities and part.command_velocity_m_s is not None:
        u = np.hstack([u, part.command_velocity_m_s])
    return u, y


def _centred(u: Array, y: Array) -> Trial:
    return u - u.mean(axis=0), y - y.mean(axis=0)
