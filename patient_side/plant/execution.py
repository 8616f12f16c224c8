"""Movements of a recording executed by an arm with dynamics of its own, for recordings of that arm."""

from dataclasses import replace

import numpy as np

from tis.common.scenario import Scenario
from tis.common.sources.trajectory import HandRecording, PoseTrack, Recording
from tis.common.units import sample_instant_ns
from tis.patient_side.plant.build import executing_plant
from tis.patient_side.plant.protocol import Reference


def executed(recording: Recording, scenario: Scenario, seed: int) -> Recording:
    """Return a recording whose arms are those of the scenario's plant, as their sensors measure them.

    The recorded poses of the arm are the set points, one for each row, and row k holds where the arm is when it gets
    set point k. Command and arm are then related as in a run: the arm's dynamics lie between them.

    Parameters
    ----------
    recording
        The movements.
    scenario
        Its ``patient.plant`` is the arm, which must not be a replay.
    seed
        Seed of the arm's sensor noise.

    Returns
    -------
    Recording
        The same commands, and the arms that followed.

    Notes
    -----
    Raises `InputError` where a package is missing that simulates the arm. Oracle: the servo's discrete-time system,
    test_execution.
    """
    hands = tuple(
        replace(hand, follower=_followed(hand, scenario, seed, recording.rate_hz)) for hand in recording.hands
    )
    return replace(recording, hands=hands)


def _followed(hand: HandRecording, scenario: Scenario, seed: int, rate_hz: int) -> PoseTrack:
    plant, wanted = executing_plant(scenario.patient.plant, seed, hand.arm), hand.follower
    found = PoseTrack(
        *(np.empty_like(values) for values in (wanted.position_m, wanted.orientation, wanted.gripper_rad))
    )
    state = plant.initial()
    rows = zip(wanted.position_m, wanted.orientation, wanted.gripper_rad, strict=True)
    for k, (place_m, orientation, gripper_rad) in enumerate(rows):
        state, moved = plant.step(
            state, Reference(place_m, orientation, float(gripper_rad)), k, sample_instant_ns(k, rate_hz)
        )
        assert moved is not None, "every row has a set point"
        found.position_m[k] = moved.measured_m
        found.orientation[k] = orientation if moved.orientation is None else moved.orientation
        found.gripper_rad[k] = gripper_rad if moved.gripper_rad is None else moved.gripper_rad
    return found
