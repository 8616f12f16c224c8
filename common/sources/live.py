"""A live operator's movement before it is made: its hands, and the synthetic hand that models are trained on."""

from typing import Final

import numpy as np

from tis.common.channels import FOLLOWER, MASTER, Hand
from tis.common.scenario.live_source import LiveSource
from tis.common.scenario.source import SyntheticSource
from tis.common.sources.provenance import digest_of_synthetic
from tis.common.sources.synthetic import synthesise
from tis.common.sources.trajectory import HandRecording, PoseTrack, Recording

_USUAL: Final = LiveSource(kind="live")
"""Places and scale of the synthetic hand, from which those of a source are counted."""


def unmade_movement(source: LiveSource, rate_hz: int) -> Recording:
    """Return the hands of a live source and the arms that they drive, without any row: nothing is known yet."""
    nothing = PoseTrack(np.empty((0, 3)), np.empty((0, 4)), np.empty(0))
    hands = tuple(HandRecording(hand, FOLLOWER[hand], nothing, nothing) for hand in source.hands)
    pairing = ", ".join(f"{MASTER[hand]} -> {FOLLOWER[hand]} (live: by convention)" for hand in source.hands)
    return Recording("live device", rate_hz, hands, start=0, pairing=pairing)


def synthetic_training(source: LiveSource, seed: int, rate_hz: int, n_rows: int) -> Recording:
    """Return ``n_rows`` rows of the synthetic hand, in the places and at the scale of a live source.

    Its speeds are those of recorded suturing. The arm is at ``scale`` times the master's movement. Oracle: least
    squares of the arm on the master, tests/common/sources/test_live.
    """
    hand_of = SyntheticSource(kind="synthetic", hands=source.hands)
    made = synthesise(hand_of, seed, rate_hz, n_rows, 0)
    digest = digest_of_synthetic(hand_of, seed, rate_hz)
    hands = tuple(_placed(source, each) for each in made.hands)
    label = f"synthetic hand, seed {seed}"
    return Recording(label, rate_hz, hands, start=0, pairing=made.pairing, digest=digest)


def _placed(source: LiveSource, made: HandRecording) -> HandRecording:
    hand: Hand = made.hand
    moved_m = np.array(source.master_at_mm.of_m(hand)) - np.array(_USUAL.master_at_mm.of_m(hand))
    arm_at_m, usual_arm_m = np.array(source.arm_at_mm.of_m(hand)), np.array(_USUAL.arm_at_mm.of_m(hand))
    arm_m = arm_at_m + source.scale / _USUAL.scale * (made.follower.position_m - usual_arm_m)
    return HandRecording(
        hand,
        made.arm,
        command=PoseTrack(made.command.position_m + moved_m, made.command.orientation, made.command.gripper_rad),
        follower=PoseTrack(arm_m, made.follower.orientation, made.follower.gripper_rad),
    )
