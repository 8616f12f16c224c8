"""The paper's filter on packets is the paper's filter on arrays, draw for draw."""

import json
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from time import perf_counter_ns

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.nodes import LEFT, Stamp, a_pose, an_arrival
from tests.patient_side.arm_models import (
    LOST,
    PHASE_NS,
    RATE_HZ,
    Streams,
    arm_model,
    at_operating_point,
    delayed,
    play,
    positions,
    random_space,
    static_model,
    tick_ns,
)
from tis.common.messages import MAX_SIZE
from tis.common.metrics.tracking import Scorable, score
from tis.common.node import Output, Record
from tis.common.records import EstimateNote
from tis.common.ticker import Ticker
from tis.common.units import sample_instant_ns
from tis.patient_side.estimators.paper import Paper
from tis.patient_side.estimators.paper_as_printed import PaperAsPrinted, read
from tis.patient_side.filters.paper_kalman import paper_filter
from tis.patient_side.hand import PatientHand
from tis.patient_side.linear_system import Array, NoiseModel, StateSpace
from tis.patient_side.node import PatientNode
from tis.patient_side.playout import Playout
from tis.patient_side.statespace import ArmModel

N = 30
COMMAND, ARM = "tis/MTML/measured_cp", "tis/PSM2/setpoint_cp"
Kind = type[Paper] | type[PaperAsPrinted]
BOTH = pytest.mark.parametrize("kind", [Paper, PaperAsPrinted])


def a_model(rng: np.random.Generator, n: int) -> ArmModel:
    root = rng.normal(size=(n + 3, n + 3))
    joint = 0.1 * root @ root.T + 0.1 * np.eye(n + 3)
    noise = NoiseModel(joint[:n, :n], joint[n:, n:], joint[:n, n:])
    model = arm_model(random_space(rng, n, 0.95), noise)
    return at_operating_point(model, rng.normal(size=3).tolist(), rng.normal(size=3).tolist())


def on_arrays(
    kind: Kind, model: ArmModel, u: Array, y: Array, delays: NDArray[np.int64], lost: NDArray[np.bool_]
) -> Array:
    """The array function in the estimators' units, with the operating point taken off and put on again."""
    z = paper_filter(
        u - model.input_offset_m,
        y - model.output_offset_m,
        model.space,
        model.noise.Q,
        model.noise.R,
        delays,
        lost,
        as_printed=kind is PaperAsPrinted,
    )
    return z + model.output_offset_m


def assert_same(kind: Kind, found: Array, expected: Array) -> None:
    """The verbatim one to the last digits; filterpy's update is in Joseph's form and rounds differently."""
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 if kind is PaperAsPrinted else 1e-10)


@BOTH
@given(seed=st.integers(0, 10_000), n=st.integers(0, 4))
@settings(max_examples=40, deadline=None)
def test_any_draws_even_those_that_no_network_can_deliver(kind: Kind, seed: int, n: int) -> None:
    """Each tick gets a playout of its own, so a sample may come again, and one of the future too."""
    rng = np.random.default_rng(seed)
    model = a_model(rng, n)
    u, y = rng.normal(size=(N, 3)), rng.normal(size=(N, 3))
    delays, lost = np.round(1.5 + 2 * rng.normal(size=N)).astype(np.int64), rng.random(N) < 0.3
    lost[0] = False
    estimator = kind(model)
    state, found, last = None, [], 0
    for k in range(N):
        if not lost[k]:
            last = min(max(k - int(delays[k]), 0), N - 1)
        playout = Playout(RATE_HZ)
        for index in range(k):
            playout.command.add(index, u[index])
        playout.arm.add(last + 1, np.full(3, 1e6))  # fresher, but not the last to arrive
        playout.arm.add(last, y[last])
        state, estimate = estimator.step(state, playout, tick_ns(k))
        assert estimate.position_m is not None
        found.append(estimate.position_m)
    assert_same(kind, np.array(found), on_arrays(kind, model, u, y, delays, lost))


def through_the_node(estimator: Paper | PaperAsPrinted, streams: Streams) -> list[EstimateNote]:
    """Messages in, logged estimates out; within a tick in the order of arrival."""
    node = PatientNode("tis", [PatientHand(LEFT, Playout(30), [estimator], None)], Ticker(30, N, PHASE_NS), lambda: 0)
    events = [(t, i, COMMAND, streams.u[i]) for i, t in enumerate(streams.u_arrival_ns) if t != LOST]
    events += [(t, i, ARM, streams.y[i]) for i, t in enumerate(streams.y_arrival_ns) if t != LOST]
    events.sort(key=lambda event: event[:3])
    outputs: list[Output] = []
    for k in range(N):
        while events and events[0][0] <= tick_ns(k):
            t, i, key, where = events.pop(0)
            node.receive(an_arrival(key, t, Stamp(i, sample_instant_ns(i, 30), 1), a_pose(*where.tolist())))
        outputs += node.wake(tick_ns(k))
    return [o.data for o in outputs if isinstance(o, Record) and isinstance(o.data, EstimateNote)]


def draws_of(arrival_ns: Sequence[int]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """The paper's draws that tell the same story: how old the last arrival is, and whether there was one."""
    order = sorted((t, i) for i, t in enumerate(arrival_ns) if t != LOST)
    delays, lost = np.zeros(N, dtype=np.int64), np.ones(N, bool)
    for k in range(N):
        arrived = [i for t, i in order if t <= tick_ns(k)]
        new = [i for t, i in order if tick_ns(k - 1) < t <= tick_ns(k)]
        lost[k] = not new
        delays[k] = k - arrived[-1] if arrived else 0
    return delays, lost


@BOTH
@given(seed=st.integers(0, 10_000), n=st.integers(1, 4))
@settings(max_examples=25, deadline=None)
def test_packets_in_any_order_with_losses_through_the_node(kind: Kind, seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    model = a_model(rng, n)
    late_ns, dropped = rng.integers(0, 200_000_000, N), rng.random(N) < 0.2
    arrivals = [LOST if dropped[i] else sample_instant_ns(i, 30) + int(late_ns[i]) for i in range(N)]
    streams = Streams(rng.normal(size=(N, 3)), rng.normal(size=(N, 3)), delayed(N, 0), arrivals)
    notes = through_the_node(kind(model), streams)
    found = np.array([[n.position_m.x, n.position_m.y, n.position_m.z] for n in notes if n.position_m is not None])
    assert_same(kind, found, on_arrays(kind, model, streams.u, streams.y, *draws_of(arrivals)))


@BOTH
def test_in_teleoperation_the_last_arrived_command_stands_in(kind: Kind) -> None:
    """Commands are 50 ms late: at tick k, 2 ms after sample k, number k - 2 is the last that has come."""
    rng = np.random.default_rng(3)
    model = a_model(rng, 2)
    u, y = rng.normal(size=(N, 3)), rng.normal(size=(N, 3))
    found = positions(play(kind(model), Streams(u, y, delayed(N, 50_000_000), delayed(N, 50_000_000))))
    # MTM[k-1] is the last argument of tick k: nothing yet at tick 1, then number k - 2
    used = np.vstack([model.input_offset_m, u[: N - 1]])
    delays = np.full(N, 2, dtype=np.int64)
    lost = np.arange(N) < 2
    assert_same(kind, found, on_arrays(kind, model, used, y, delays, lost))


def test_the_command_is_the_one_before_the_newest_sample_instant() -> None:
    playout = Playout(RATE_HZ)
    for index in (5, 7, 6):
        playout.command.add(index, np.full(3, float(index)))
    model = static_model()
    instants = [sample_instant_ns(7, 30) - 1, sample_instant_ns(7, 30), tick_ns(8), sample_instant_ns(9, 30)]
    # 8 has not arrived at the last one: 6 came last
    assert [read(model, playout, t).u[0] for t in instants] == [5.0, 6.0, 7.0, 6.0]


@BOTH
def test_by_hand_on_packets(kind: Kind) -> None:
    """The example of test_paper_kalman, about the operating point u = 10, y = (1, 2)."""
    space = StateSpace(np.array([[0.5]]), np.array([[1.0]]), np.array([[1.0], [2.0]]), np.full((2, 1), 100.0))
    noise = NoiseModel(np.array([[0.75]]), np.array([[1.0, 0.3], [0.3, 4.0]]), np.ones((1, 2)))
    model = at_operating_point(arm_model(space, noise), [10.0], [1.0, 2.0])
    y = np.array([[1.0, 2.0], [4.0, 9.0], [9.0, 9.0]])
    streams = Streams(np.array([[11.0], [9.0], [19.0]]), y, delayed(3, 0), [0, tick_ns(1), LOST])
    estimates = play(kind(model), streams)
    by_hand = {PaperAsPrinted: [2.25, 4.5, 1.7, 3.4], Paper: [2.5, 5.0, 2.125, 4.25]}
    about_operating_point = positions(estimates) - np.array([1.0, 2.0])
    np.testing.assert_allclose(about_operating_point.ravel(), [0.0, 0.0, *by_hand[kind]], rtol=1e-14)
    if kind is PaperAsPrinted:
        assert [e.covariance_m2 for e in estimates] == [None] * 3
    else:  # P = 1, 1/3, 5/16
        for estimate, variance in zip(estimates, (1.0, 1 / 3, 5 / 16), strict=True):
            assert estimate.covariance_m2 is not None
            np.testing.assert_allclose(estimate.covariance_m2, variance * np.array([[1, 2], [2, 4]]), rtol=1e-14)


@pytest.mark.parametrize(("kind", "sees"), [(Paper, [0, 1, 2]), (PaperAsPrinted, [2])])
def test_channels_that_count(kind: Kind, sees: list[int]) -> None:
    rng = np.random.default_rng(5)
    model = a_model(rng, 3)
    streams = Streams(rng.normal(size=(N, 3)), rng.normal(size=(N, 3)), delayed(N, 0), delayed(N, 0))
    before = positions(play(kind(model), streams))
    for channel in range(3):
        moved = streams.y.copy()
        moved[:, channel] += 1.0
        after = positions(play(kind(model), replace(streams, y=moved)))
        assert np.array_equal(after, before) == (channel not in sees)


@BOTH
def test_without_states_it_answers_with_the_operating_point(kind: Kind) -> None:
    model = at_operating_point(static_model(), [1.0, 2.0, 3.0], [4.0, 5.0, 6.0])
    streams = Streams(np.ones((3, 3)), np.ones((3, 3)), delayed(3, 0), delayed(3, 0))
    estimates = play(kind(model), streams)
    assert positions(estimates).tolist() == [[4.0, 5.0, 6.0]] * 3
    assert [e.covariance_m2 for e in estimates] == [None] * 3


@BOTH
def test_before_anything_has_arrived_it_answers_with_the_operating_point(kind: Kind) -> None:
    model = a_model(np.random.default_rng(1), 2)
    nothing = Streams(np.ones((3, 3)), np.ones((3, 3)), [LOST] * 3, [LOST] * 3)
    assert positions(play(kind(model), nothing)).tolist() == [model.output_offset_m.tolist()] * 3


@BOTH
@pytest.mark.parametrize("seen", [1.0, 0.0])
def test_divergence_ends_in_missing_estimates_and_finite_scores(kind: Kind, seen: float) -> None:
    """A state that grows 10^12 fold a tick, and that no channel or only the first one sees.

    Commands push it so far that its square overflows before it does itself.
    """
    B, C = np.array([[1e60] * 3, [1.0] * 3]), np.array([[seen, 1], [0, 1], [0, 1]])
    space = StateSpace(np.diag([1e12, 0.5]), B, C, np.zeros((3, 3)))
    model = arm_model(space, NoiseModel(np.eye(2), np.eye(3), np.zeros((2, 3))))
    rng = np.random.default_rng(1)
    streams = Streams(rng.normal(size=(N, 3)), rng.normal(size=(N, 3)), delayed(N, 0), delayed(N, 0))
    notes = through_the_node(kind(model), streams)
    rows = [n.position_m and [n.position_m.x, n.position_m.y, n.position_m.z] for n in notes]
    answers = np.array([[np.nan] * 3 if row is None else row for row in rows])
    missing = ~np.isfinite(answers).all(axis=1)
    first = int(np.argmax(missing))
    assert first > 0
    assert np.max(np.abs(answers[~missing])) <= MAX_SIZE
    if not (kind is Paper and seen):  # that one corrects what it sees, and comes back
        assert missing[first:].all()
    hold = streams.y + 0.1
    result = score(Scorable(answers, hold, streams.y, np.ones(N, bool), np.ones(3)))
    assert result["n_missing"] == np.count_nonzero(missing)
    json.dumps(result, allow_nan=False)


@BOTH
def test_a_channel_without_noise_that_sees_nothing_ends_in_missing_estimates(kind: Kind) -> None:
    """Its gain is 0/0."""
    space = StateSpace(np.eye(1), np.ones((1, 3)), np.array([[1.0], [1.0], [0.0]]), np.zeros((3, 3)))
    model = arm_model(space, NoiseModel(np.eye(1), np.diag([1.0, 1.0, 0.0]), np.zeros((1, 3))))
    streams = Streams(np.ones((3, 3)), np.ones((3, 3)), delayed(3, 0), delayed(3, 0))
    assert [e.position_m is None for e in play(kind(model), streams)] == [False, True, True]


def test_covariance_of_the_repaired_filter_is_what_filterpy_carries() -> None:
    """At rest it solves P = (I - K C)(A P A' + Q), here found by iterating the batch form."""
    rng = np.random.default_rng(7)
    model = a_model(rng, 3)
    space, noise = model.space, model.noise
    streams = Streams(rng.normal(size=(N, 3)), rng.normal(size=(N, 3)), delayed(N, 0), delayed(N, 0))
    covariance = play(Paper(model), streams)[-1].covariance_m2
    P: Array = np.eye(3)
    for _ in range(200):
        P = space.A @ P @ space.A.T + noise.Q
        P = np.asarray(np.linalg.inv(np.linalg.inv(P) + space.C.T @ np.diag(1 / np.diag(noise.R)) @ space.C), float)
    assert covariance is not None
    np.testing.assert_allclose(covariance, space.C @ P @ space.C.T, rtol=1e-8)


@BOTH
def test_a_step_leaves_its_state_alone_and_costs_little(kind: Kind) -> None:
    rng = np.random.default_rng(2)
    estimator = kind(a_model(rng, 10))
    playout = Playout(RATE_HZ)
    playout.command.add(0, rng.normal(size=3))
    playout.arm.add(0, rng.normal(size=3))
    state, _ = estimator.step(None, playout, tick_ns(0))
    state, _ = estimator.step(state, playout, tick_ns(1))
    x, P = state.x.copy(), state.P.copy()
    stamps, answers = [perf_counter_ns()], []
    for _ in range(30):
        answers.append(estimator.step(state, playout, tick_ns(2))[1])
        stamps.append(perf_counter_ns())
    assert np.array_equal(state.x, x)
    assert np.array_equal(state.P, P)
    assert np.ptp(positions(answers), axis=0).tolist() == [0.0] * 3
    assert min(b - a for a, b in pairwise(stamps)) < 1_000_000  # 3 % of a tick
