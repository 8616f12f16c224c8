"""The movement of a run as known before it, and the training rows of its models, for every kind of source."""

from collections.abc import Sequence

from tis.common.runtime.recordings import load_recording, load_training
from tis.common.scenario import Scenario
from tis.common.sources.live import synthetic_training, unmade_movement
from tis.common.sources.sensor_noise import with_noise
from tis.common.sources.trajectory import Recording


def load_movement(scenario: Scenario) -> Recording:
    """Return what `load_recording` does, and of a live source its hands without rows; raises as `load_recording`."""
    source = scenario.source
    return unmade_movement(source, scenario.rate_hz) if source.kind == "live" else load_recording(scenario)


def training_rows_for(scenario: Scenario, movement: Recording) -> Sequence[Recording]:
    """Return `load_training`'s rows, and for ``train: synthetic`` the synthetic hand's; raises as `load_training`."""
    source, identification = scenario.source, scenario.identification
    if source.kind != "live" or identification.train != "synthetic":
        return load_training(scenario, movement)
    made = synthetic_training(source, scenario.seed, scenario.rate_hz, identification.train_samples)
    return [with_noise(made, identification.sensor_noise_m, scenario.seed)]
