"""Times of steps: rounds in turn, medians over them, and rates; no figure of this machine is asserted."""

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from tis.common.estimators import scenario_name
from tis.deploy.bench.estimators import Samples
from tis.deploy.run.resolve import resolve
from tis.deploy.shell.progress import PhaseProgress
from tis.deploy.studies.methods import steps
from tis.deploy.studies.methods.plans import ALL
from tis.deploy.studies.methods.steps import Play, Stepped, play_rounds, stepped
from tis.deploy.studies.methods.trials import Extent
from tis.patient_side.estimators.protocol import Estimate
from tis.patient_side.estimators.simple import Hold
from tis.patient_side.playout import Playout

EXTENT = Extent(n_rounds=3, n_ticks=100)


class Counted:
    """An estimator that notes in which order entries are stepped."""

    def __init__(self, name: str, seen: list[str]) -> None:
        self.name, self.seen = name, seen

    def initial(self) -> None:
        return None

    def step(self, state: Any, playout: Playout, now_ns: int) -> tuple[None, Estimate]:
        if now_ns < 10_000_000:  # the first tick of a play
            self.seen.append(self.name)
        return None, Estimate(None)


def samples(n: int = 120) -> Samples:
    return Samples(np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n))


def progress() -> PhaseProgress:
    return PhaseProgress(Console(file=io.StringIO()))


def test_all_entries_are_played_in_turn_both_hands_with_the_models_of_all_rows_only() -> None:
    seen: list[str] = []
    entries = [
        Stepped("a", "data", ALL, ((Counted("a left", seen), samples()), (Counted("a right", seen), samples()))),
        Stepped("b", "size", "5", ((Counted("b left", seen), samples()), (Counted("b right", seen), samples()))),
    ]
    play_rounds(entries, EXTENT, progress())
    assert seen == ["a left", "a right", "b left"] * 3
    assert [len(entry.plays) for entry in entries] == [3, 3]
    assert entries[0].figure("rate_both_hz") is not None
    assert entries[1].figure("rate_both_hz") is None


def test_the_rate_of_both_hands_is_below_that_of_one() -> None:
    entry = Stepped("hold", "data", ALL, ((Hold(), samples()), (Hold(), samples())))
    play_rounds([entry], EXTENT, progress())
    for play in entry.plays:
        assert play.rate_hz is not None
        assert play.rate_both_hz is not None
        assert play.p50_us <= play.p99_us


def test_a_trial_that_is_shorter_than_the_plays_is_played_to_its_end() -> None:
    entry = Stepped("hold", "data", "1", ((Hold(), samples(80)),))
    play_rounds([entry], EXTENT, progress())
    assert len(entry.plays) == 3


def test_a_figure_is_the_median_of_the_rounds_that_have_it() -> None:
    plays = [Play(p50, p50, rate, None, 0.1) for p50, rate in ((5.0, 100.0), (1.0, None), (9.0, 300.0))]
    entry = Stepped("hold", "data", ALL, (), plays)
    assert (entry.figure("p50_us"), entry.figure("rate_hz"), entry.figure("rate_both_hz")) == (5.0, 200.0, None)


def test_a_method_that_no_scenario_has_built_in_is_stepped_as_a_user_s(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(steps, "with_models", lambda scenario, _: scenario)
    estimators = ("active_estimator=hold", f"estimators=[hold, '{scenario_name('paper')}']")
    settings = ("duration_s=2", "identification.train_samples=300", *estimators)
    found = stepped("paper", "accuracy", "100", resolve("default", settings, None, None), Path())
    assert (found.method, len(found.hands)) == ("paper", 1)
