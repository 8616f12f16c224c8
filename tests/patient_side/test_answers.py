"""Users' own estimators among the testbed's: their failures are told once and counted, and stay theirs."""

from typing import Any

import numpy as np
import pytest

from tests.nodes import LEFT, Stamp, a_pose, an_arrival
from tis.common.node import Emission, Output, Record
from tis.common.records import ESTIMATES, ESTIMATOR_FAULTS, FAULTY_STEPS, CounterNote, EstimateNote, EstimatorFault
from tis.common.ticker import Ticker
from tis.patient_side.estimators.guarded import Guarded
from tis.patient_side.estimators.protocol import Estimate, Estimator
from tis.patient_side.estimators.simple import Hold
from tis.patient_side.hand import PatientHand
from tis.patient_side.node import PatientNode
from tis.patient_side.playout import Playout

ARM = "tis/PSM2/setpoint_cp"
PHASE_NS = 2_000_000
PERIOD_NS = 33_333_333
NAME = "my.lab:Filter"


class Meddles:
    """Changes what it reads, at every second tick."""

    def initial(self) -> int:
        return 0

    def step(self, state: int, playout: Playout, now_ns: int) -> tuple[int, Estimate]:
        where_m = playout.arm.get(playout.arm.newest)
        if where_m is None:
            raise LookupError("too early")
        if now_ns // PERIOD_NS % 2:
            where_m += 1.0
        return state + 1, Estimate(where_m, np.eye(3))


def node(*estimators: Estimator, on_arrival: bool = False) -> PatientNode:
    hand = PatientHand(LEFT, Playout(30), estimators, plant=None)
    return PatientNode("tis", [hand], Ticker(30, 20, PHASE_NS), lambda: 0, on_arrival=on_arrival)


def play(patient: PatientNode, n_ticks: int) -> list[Output]:
    """Return what it puts out in so many ticks, a sample before each but the first."""
    outputs: list[Output] = []
    for k in range(n_ticks):
        if k:
            sample_ns = (k - 1) * PERIOD_NS
            at_ns = k * PERIOD_NS + PHASE_NS // 2
            patient.receive(an_arrival(ARM, at_ns, Stamp(k, sample_ns, sample_ns), a_pose(0.1 * k)))
            if patient.on_arrival:
                outputs += patient.wake(at_ns)
        outputs += patient.wake(patient.ticker.due_ns(k))
    return outputs


def of(outputs: list[Output], kind: type[Any]) -> list[Any]:
    return [output.data for output in outputs if isinstance(output, Record) and isinstance(output.data, kind)]


@pytest.mark.parametrize("active", [True, False])
def test_a_failure_is_told_once_counted_and_nobody_elses(active: bool) -> None:
    own = Guarded(NAME, Meddles())
    outputs = play(node(*((own, Hold()) if active else (Hold(), own))), 7)
    (told,) = of(outputs, EstimatorFault)
    reason = "LookupError: too early (test_answers.py, line 34)"
    assert told == EstimatorFault(t_ns=PHASE_NS, hand="left", estimator=NAME, reason=reason)
    (record,) = (output for output in outputs if isinstance(output, Record) and output.topic == ESTIMATOR_FAULTS)
    assert record.log_ns == PHASE_NS
    answers = {(note.estimator, note.tick): note.position_m for note in of(outputs, EstimateNote)}
    assert [answers[NAME, k] is None for k in range(7)] == [True, True, False, True, False, True, False]
    # what the other reads is as it was sent, though its neighbour tried to change it
    assert [at.x for k in range(1, 7) if (at := answers["hold", k]) is not None] == pytest.approx(
        [0.1 * k for k in range(1, 7)]
    )
    n_published = sum(isinstance(output, Emission) for output in outputs)
    assert n_published == (3 if active else 6)


def test_how_often_each_failed_is_a_counter_and_there_is_none_without_own_ones() -> None:
    patient = node(Hold(), Guarded(NAME, Meddles()))
    play(patient, 5)
    assert patient.counters()[f"{FAULTY_STEPS}.{NAME}"] == 3
    notes = [record.data for record in patient.finish(0)]
    assert CounterNote(name=f"{FAULTY_STEPS}.{NAME}", value=3) in notes
    assert not any(name.startswith(FAULTY_STEPS) for name in node(Hold()).counters())


def test_answers_at_arrivals_are_guarded_as_well() -> None:
    own = Guarded(NAME, Meddles())
    patient = node(own, on_arrival=True)
    outputs = play(patient, 5)
    assert len(of(outputs, EstimateNote)) == 5
    assert own.n_steps == 9
    assert patient.hands[0].states == [2]  # of the ticks alone: those at which it meddles, and arrivals, leave it


def test_its_topic_is_a_legal_one() -> None:
    outputs = play(node(Hold(), Guarded(NAME, Meddles())), 2)
    topics = {output.topic for output in outputs if isinstance(output, Record)}
    assert {topic for topic in topics if topic.startswith(ESTIMATES)} == {
        f"{ESTIMATES}/hold",
        f"{ESTIMATES}/my_lab__Filter",
    }
