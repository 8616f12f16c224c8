"""Known joint states are found again; correlated delays alone do not make states."""

import numpy as np
import pytest

from tests.netem.fit.synthetic_records import Parameters, record
from tis.netem.fit.switching import fit_switching, successors


@pytest.mark.parametrize(("bad_delay", "p_bad"), [(15.0, 0.5), (15.0, 0.02), (0.0, 0.5)])
def test_states_of_delay_or_loss_or_both_are_found(bad_delay: float, p_bad: float) -> None:
    of = Parameters(seconds=200, good=8, bad=2, bad_delay=bad_delay, p_bad=p_bad)
    trace = record("bad_states", of, seed=4)
    found = fit_switching(trace.sent_ns, trace.delay_ns, np.ones(len(trace.sent_ns) - 1, dtype=bool), 2)
    assert found is not None
    stays_s = [0.01 / (1 - found.transition[i, i]) for i in (0, 1)]
    assert stays_s[0] == pytest.approx(8, rel=0.6)
    assert stays_s[1] == pytest.approx(2, rel=0.6)
    assert found.p_loss[1] == pytest.approx(p_bad, abs=0.05)
    assert found.p_loss[0] < 0.01


def test_successors_are_those_of_the_chain() -> None:
    transition = np.array([[0.98, 0.015, 0.005], [0.1, 0.9, 0.0], [0.0, 0.2, 0.8]])
    assert successors(transition, ["a", "b", "c"], 0.01) == [
        {"mean_s": 0.5, "next": [{"to": "b", "weight": 0.75}, {"to": "c", "weight": 0.25}]},
        {"mean_s": 0.1, "next": [{"to": "a", "weight": 1.0}]},
        {"mean_s": 0.05, "next": [{"to": "b", "weight": 1.0}]},
    ]
