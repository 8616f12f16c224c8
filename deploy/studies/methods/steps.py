"""Times of steps in one process: all models of all methods in interleaved rounds on the same arrivals.

Rounds are interleaved so that a busy second of the machine disturbs all alike; of each figure the median over the
rounds counts. Wall-clock time, the garbage collector off, as in a run.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Final

import numpy as np

from tis.common.estimators import scenario_name
from tis.common.runtime.recordings import load_recording
from tis.common.scenario import Scenario
from tis.common.sources.trajectory import HandRecording
from tis.common.units import NS_PER_US
from tis.deploy.bench.estimators import Arrival, Network, Samples, arrivals_of, step_times_us
from tis.deploy.compare.cells.cell import with_models
from tis.deploy.shell.progress import PhaseProgress
from tis.deploy.studies.methods.plans import ALL, Measure
from tis.deploy.studies.methods.trials import DELAY_MS, Extent
from tis.patient_side.estimators.guarded import build_any
from tis.patient_side.estimators.protocol import Estimator
from tis.patient_side.models import factories, models_for, own_estimators

# Highest rate of ticks that measured steps keep up with.

NS_PER_S: Final = 1_000_000_000


def misses_a_tick(steps_ns: Sequence[int], period_ns: int) -> bool:
    """Tell whether steps that take ``steps_ns`` miss a tick where one is due every ``period_ns``.

    A step begins when its tick is due, or when the step before it ends, if that is later. A tick is missed when its
    step has not begun before the next tick is due, as in a run (`tis.common.ticker`). Nothing else takes time here.
    """
    behind_ns = 0
    for step_ns in steps_ns[:-1]:
        behind_ns = max(0, behind_ns + step_ns - period_ns)
        if behind_ns >= period_ns:
            return True
    return False


def highest_rate_hz(steps_ns: Sequence[int]) -> float | None:
    """Return the highest rate at which the steps, in this order, miss no tick; None with fewer than two steps.

    The rate is that of the shortest such period in whole ns, found by bisection: a longer period never misses more.
    The steps are assumed to take at that rate what they were measured to take. Oracle: hand-written sequences, and
    all periods tried in turn, test_tick_rate.
    """
    if len(steps_ns) < 2:
        return None
    low_ns, high_ns = 0, max(1, max(steps_ns))  # a period as long as the longest step misses none
    while high_ns - low_ns > 1:
        middle_ns = (low_ns + high_ns) // 2
        if misses_a_tick(steps_ns, middle_ns):
            low_ns = middle_ns
        else:
            high_ns = middle_ns
    return NS_PER_S / high_ns


NETWORK: Final = Network("methods", (DELAY_MS, DELAY_MS), 0.0)
_WARM: Final = 60
_LONG_S: Final = 2.0
"""Plays of a method that take longer are repeated in the first rounds only."""
_FEWEST: Final = 2


@dataclass(frozen=True)
class Stepped:
    """A method with the models of one training: of all rows (``data``, ``ALL``), of fewer, or of another size.

    ``hands`` are the estimators of both hands, each with its samples.
    """

    method: str
    measure: Measure
    setting: str
    hands: tuple[tuple[Estimator, Samples], ...]
    plays: list["Play"] = field(default_factory=list)

    def figure(self, name: str) -> float | None:
        """Return the median of a figure over the rounds, None without any."""
        values = [value for play in self.plays if (value := getattr(play, name)) is not None]
        return median(values) if values else None


@dataclass(frozen=True)
class Play:
    """Figures of one round: steps of the first hand in us, rates for one hand and for both in turn in Hz."""

    p50_us: float
    p99_us: float
    rate_hz: float | None
    rate_both_hz: float | None
    took_s: float


def stepped(method: str, measure: Measure, setting: str, scenario: Scenario, model_file: Path) -> Stepped:
    """Return a method's estimators with the models of a file, and the samples of the scenario's trial.

    Raises `InputError` and `DataError`, as a run with the scenario does.
    """
    filled = with_models(scenario, model_file)
    recording = load_recording(filled)
    models = models_for(filled, recording)
    name, own = scenario_name(method), factories(own_estimators(filled))  # a study's are as those of a user
    hands = tuple(
        (build_any(name, model, own), _samples(hand)) for model, hand in zip(models, recording.hands, strict=True)
    )
    return Stepped(method, measure, setting, hands)


def play_rounds(entries: Sequence[Stepped], extent: Extent, progress: PhaseProgress) -> None:
    """Play all entries in turn, round after round; each entry notes its plays."""
    progress.total("rounds of steps", extent.n_rounds)
    arrivals: dict[int, list[Arrival]] = {}
    for number in range(extent.n_rounds):
        for entry in entries:
            took_s = sum(play.took_s for play in entry.plays)
            if number >= _FEWEST and took_s > _LONG_S:
                continue
            entry.plays.append(_play(entry, extent, arrivals))
        progress.advance("rounds of steps")


def _play(entry: Stepped, extent: Extent, arrivals: dict[int, list[Arrival]]) -> Play:
    """Play the trial once for each hand; a setting other than that of all rows needs the first hand only."""
    each = []
    for estimator, samples in entry.hands if entry.setting == ALL else entry.hands[:1]:
        n = min(extent.n_ticks, len(samples.command_m))
        cut = Samples(samples.command_m[:n], samples.arm_m[:n], samples.gripper_rad[:n])
        if n not in arrivals:
            arrivals[n] = sorted(arrivals_of(NETWORK, n, arm=False) + arrivals_of(NETWORK, n, arm=True))
        each.append(step_times_us(estimator, cut, arrivals[n])[_WARM:])
    one = each[0]
    both = np.sum(each, axis=0) if len(each) > 1 else None
    p50, p99 = np.percentile(one, [50, 99])
    return Play(
        float(p50),
        float(p99),
        highest_rate_hz(_ns(one)),
        None if both is None else highest_rate_hz(_ns(both)),
        float(sum(steps.sum() for steps in each)) / 1e6,
    )


def _ns(steps_us: "np.ndarray[tuple[int, ...], np.dtype[np.float64]]") -> list[int]:
    return [round(value * NS_PER_US) for value in steps_us.tolist()]


def _samples(hand: HandRecording) -> Samples:
    return Samples(hand.command.position_m, hand.follower.position_m, hand.follower.gripper_rad)
