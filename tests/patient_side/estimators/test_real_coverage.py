"""On recorded trials the truth lies in the 95 % ellipsoids as often as it should, under delay and loss.

Each trial is of a subject that the models know nothing of.
"""

from pathlib import Path

import numpy as np
import pytest

from tests.patient_side.arm_models import LOST, RATE_HZ, Streams, inside_95, play, truth_at_ticks
from tests.patient_side.identification.known_systems import real_recording
from tis.common.scenario.identification import Identification
from tis.common.units import sample_instant_ns
from tis.patient_side.estimators.builders import build_estimator
from tis.patient_side.identification.identify import identify_arm
from tis.patient_side.statespace import ArmModel

WITH_COVARIANCE: list[str] = [
    *("damped_velocity", "moesp_kf", "n4sid_kf", "arx_kf", "innovations_kf", "direct_ls", "drmf"),
]
N = 1000
TRAINED_ON = {"C004": "E003", "D002": "E003", "E003": "C004", "F003": "C004"}
"""Each trial, and the one of another subject that its models are of."""
NETWORKS = ((100, 100, 0.01), (50, 450, 0.05))
"""Shortest and longest delay, in ms, and the probability of a loss."""


@pytest.fixture(scope="module")
def known(jigsaws_dir: Path) -> list[tuple[ArmModel, list[Streams]]]:
    """Each trial's left hand, as it arrives through each network, with models of another subject."""
    recordings = {name: real_recording(jigsaws_dir, f"Suturing_{name}") for name in TRAINED_ON}
    rng, found = np.random.default_rng(1), []

    def arrivals(low_ms: int, high_ms: int, p_loss: float) -> list[int]:
        late_ns, lost = rng.integers(low_ms, high_ms + 1, N) * 1_000_000, rng.random(N) < p_loss
        return [LOST if lost[i] else sample_instant_ns(i, RATE_HZ) + int(late_ns[i]) for i in range(N)]

    models = {
        other: identify_arm(
            [recordings[other].head(1500)], "left", Identification(train="others"), "cross", WITH_COVARIANCE
        )
        for other in set(TRAINED_ON.values())
    }
    for name, other in TRAINED_ON.items():
        hand = next(hand for hand in recordings[name].hands if hand.hand == "left")
        u, y = hand.command.position_m[:N], hand.follower.position_m[:N]
        found.append((models[other], [Streams(u, y, arrivals(*network), arrivals(*network)) for network in NETWORKS]))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", WITH_COVARIANCE)
def test_95_per_cent_are_about_95_per_cent(known: list[tuple[ArmModel, list[Streams]]], name: str) -> None:
    for network in range(len(NETWORKS)):
        inside = [share for model, streams in known for share in _inside(name, model, streams[network])]
        assert 0.90 <= np.mean(inside) <= 0.98


def _inside(name: str, model: ArmModel, streams: Streams) -> list[bool]:
    scored = slice(100, -1)
    return inside_95(play(build_estimator(name, model), streams)[scored], truth_at_ticks(streams.y)[scored])
