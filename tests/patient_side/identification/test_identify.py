from pathlib import Path

import numpy as np
import pytest

from tests.patient_side.identification.known_systems import (
    ONE_LAG,
    REAL_TRIALS,
    Array,
    hand_like,
    markov,
    real_recording,
    recording,
    sorted_eigenvalues,
)
from tis.common.errors import DataError
from tis.common.scenario.identification import Identification
from tis.common.scenario.source import SyntheticSource
from tis.common.sources.provenance import RecordedRows
from tis.common.sources.synthetic import synthesise
from tis.patient_side.estimators.simple import dc_gain
from tis.patient_side.identification.identify import identify_arm, identify_with_orders


def gain_pair(n_rows: int, seed: int, residual_m: float = 15e-6) -> tuple[Array, Array]:
    u = hand_like(n_rows, seed) + np.array([0.1, -0.05, 0.2])
    return u, 0.5 * u + np.array([0.02, 0.03, -0.1]) + residual_m * np.random.default_rng(seed).normal(size=u.shape)


def lag_pair(n_rows: int, seed: int) -> tuple[Array, Array]:
    u = hand_like(n_rows, seed)
    noise = 1e-5 * np.random.default_rng(seed).normal(size=u.shape)
    return u, ONE_LAG.simulate(u, u[0] / 2) + noise + 0.1


def test_a_gain_is_recognised_as_static() -> None:
    u, y = gain_pair(1240, 0)
    identified = identify_with_orders([recording("T", {"left": (u, y)})], "left", Identification(), "crossed")
    model = identified.model
    assert (model.order, model.static, model.spectral_radius) == (0, True, 0.0)
    assert pytest.approx(0.5 * np.eye(3), abs=1e-3) == model.space.D
    assert np.sqrt(np.diag(model.noise.R)) == pytest.approx([15e-6] * 3, rel=0.1)
    predicted = model.space.D @ (u[7] - model.input_offset_m) + model.output_offset_m
    assert predicted == pytest.approx(y[7], abs=6e-5)
    assert (model.hand, model.arm, model.rate_hz, model.pairing) == ("left", "PSM2", 30, "crossed")
    assert (model.method, model.block_rows, model.train) == ("moesp", 10, "own_head")
    assert model.trained_on == (RecordedRows("T", "", 0, 1240, 30),)
    assert min(model.fit_pct) > 99.9
    assert len(model.singular_values) == 30
    assert identified.orders.validation == 0
    assert (identified.orders.energy or 0) > 10  # noise alone: the energy rule counts nearly all of it


def test_a_lag_is_found_and_simulates_fresh_rows() -> None:
    u, y = lag_pair(1640, 1)
    model = identify_arm([recording("T", {"left": (u[:1240], y[:1240])})], "left", Identification(), "")
    assert (model.order, model.static) == (3, False)
    assert sorted_eigenvalues(model.space.A) == pytest.approx([0.7] * 3, abs=0.01)
    assert markov(model.space, 15) == pytest.approx(markov(ONE_LAG, 15), abs=5e-3)
    simulated = model.space.simulate(u - model.input_offset_m, model.x0) + model.output_offset_m
    assert np.sqrt(np.mean((simulated[1240:] - y[1240:]) ** 2)) < 3e-5
    assert np.sqrt(np.mean((simulated[:3] - y[:3]) ** 2)) < 5e-5  # x0 is the state at the first row


@pytest.mark.parametrize("bandwidth_hz", [1.0, 2.0])
def test_of_an_arm_that_lags_as_a_servo_the_poles_are_the_servos(bandwidth_hz: float) -> None:
    """Poles of the sampled arm are ``exp(s dt)``, s those of ``s^2 + 2 zeta w s + w^2``, on each axis."""
    source = SyntheticSource(
        kind="synthetic", arm_bandwidth_hz=bandwidth_hz, arm_damping=0.6, recorder_hz=None, drift_mm=2.0
    )
    lagging = synthesise(source, 3, 30, 3600, 0)
    model = identify_arm([lagging], "left", Identification(order=6), "by construction")
    w = 2.0 * np.pi * bandwidth_hz
    pole = np.exp(complex(-0.6 * w, 0.8 * w) / 30)
    assert not model.static
    poles = np.linalg.eigvals(model.space.A)
    assert poles[poles.imag > 0] == pytest.approx(np.full(3, pole), abs=0.02)
    assert dc_gain(model.space) == pytest.approx(0.5 * np.eye(3), abs=0.02)


def test_an_order_that_is_given_is_used_and_validated() -> None:
    training = [recording("T", {"left": lag_pair(600, 2)})]
    identified = identify_with_orders(training, "left", Identification(order=1, block_rows=5), "")
    automatic = identify_with_orders(training, "left", Identification(block_rows=5), "")
    assert identified.orders == automatic.orders
    assert identified.model.order == 1
    assert identified.model.fit_pct == automatic.orders.fits[1].fit_pct
    assert not identify_arm(training, "left", Identification(order=0, block_rows=5), "").space.A.size


@pytest.mark.parametrize("method", ["moesp", "pi_moesp", "n4sid", "cva", "arx"])
def test_every_method_finds_the_lag(method: str) -> None:
    u, y = lag_pair(1240, 1)
    identification = Identification.model_validate({"method": method})
    identified = identify_with_orders([recording("T", {"left": (u, y)})], "left", identification, "")
    model, orders = identified.model, identified.orders
    assert (model.method, model.static) == (method, False)
    assert markov(model.space, 10) == pytest.approx(markov(ONE_LAG, 10), abs=1e-2)
    assert min(model.fit_pct) > 99.5
    assert orders.validation == (1 if method == "arx" else 3)  # lags and states
    assert orders.predictions[orders.validation] < 0.05
    assert (orders.energy is None) == (len(model.singular_values) == 0) == (method == "arx")


def test_every_method_recognises_a_gain() -> None:
    for method in ("pi_moesp", "n4sid", "cva", "arx"):
        identification = Identification.model_validate({"method": method})
        model = identify_arm([recording("T", {"left": gain_pair(900, 0)})], "left", identification, "")
        assert (model.order, model.static) == (0, True)
        assert pytest.approx(0.5 * np.eye(3), abs=2e-3) == model.space.D


@pytest.mark.parametrize("rule", ["energy", "gap", "criterion", "validation"])
def test_the_order_is_the_one_of_the_rule_that_is_named(rule: str) -> None:
    u, y = lag_pair(700, 2)
    identification = Identification.model_validate({"order": rule, "block_rows": 5})
    identified = identify_with_orders([recording("T", {"left": (u, y)})], "left", identification, "")
    orders = identified.orders
    by_name = {"energy": orders.energy, "gap": orders.log_gap, "criterion": orders.criterion}
    assert identified.model.order == by_name.get(rule, orders.validation)


def test_a_rule_of_singular_values_is_refused_for_arx() -> None:
    identification = Identification.model_validate({"order": "energy", "method": "arx"})
    with pytest.raises(DataError, match=r"order: needs singular values, and arx has none \(got 'energy'\)"):
        identify_arm([recording("T", {"left": lag_pair(700, 2)})], "left", identification, "")


def test_what_an_estimator_needs_is_found_only_where_it_is_wanted() -> None:
    training = [recording("T", {"left": gain_pair(900, 0)})]
    plain = identify_arm(training, "left", Identification(), "")
    assert (plain.n4sid, plain.arx, plain.direct) == (None, None, None)
    paper = Identification(method="moesp_paper")
    wanted = identify_arm(training, "left", paper, "", ["n4sid_kf"])
    assert wanted.n4sid is not None
    # the paper's operating point is the lower end of the range, the other model's is the mean
    _, y = gain_pair(900, 0)
    assert wanted.n4sid.output_offset_m == pytest.approx(y.mean(axis=0))
    assert wanted.output_offset_m == pytest.approx(y.min(axis=0))


def test_others_pool_both_hands_and_start_at_the_operating_point() -> None:
    trainings = [
        recording(f"T{i}", {"left": lag_pair(900, 10 + i), "right": lag_pair(800, 20 + i)}) for i in range(2)
    ]
    model = identify_arm(trainings, "right", Identification(train="others"), "")
    assert (model.order, model.train, model.arm) == (3, "others", "PSM1")
    assert sorted_eigenvalues(model.space.A) == pytest.approx([0.7] * 3, abs=0.02)
    assert np.array_equal(model.x0, np.zeros(3))
    alone = np.concatenate([trainings[i].hands[1].follower.position_m for i in range(2)])
    assert model.output_offset_m == pytest.approx(alone.mean(axis=0))


def test_unrelated_signals_are_warned_of() -> None:
    training = [recording("T", {"left": (hand_like(800, 3), hand_like(800, 4))}, same_name=True)]
    model = identify_arm(training, "left", Identification(), "")
    assert not model.static
    assert any("it may not be the arm that follows the left hand" in w for w in model.warnings)


def test_too_few_rows_name_the_rows_needed_for_fit_and_validation() -> None:
    with pytest.raises(DataError, match=r"need 198 rows in one trial, 30 % of them to validate on.*\(got 197\)"):
        identify_arm([recording("T", {"left": gain_pair(197, 5)})], "left", Identification(), "")
    identify_arm([recording("T", {"left": gain_pair(198, 5)})], "left", Identification(), "")


def test_faults_name_the_recording_and_the_hand() -> None:
    u, y = gain_pair(400, 6)
    y[33, 1] = np.nan
    with pytest.raises(DataError, match=r"Suturing_X001, left hand: output: must be finite: 1 values .* in row 33$"):
        identify_arm([recording("Suturing_X001", {"left": (u, y)})], "left", Identification(), "")


def test_the_result_does_not_depend_on_the_rows_after_the_training_part() -> None:
    u, y = lag_pair(500, 7)
    whole = recording("T", {"left": (u, y)})
    before = identify_arm([whole.head(400)], "left", Identification(block_rows=5), "")
    y[400:] += 1.0
    after = identify_arm([whole.head(400)], "left", Identification(block_rows=5), "")
    assert np.array_equal(before.space.A, after.space.A)
    assert np.array_equal(before.output_offset_m, after.output_offset_m)


@pytest.mark.parametrize("trial", REAL_TRIALS)
def test_real_arms_are_static_gains_of_a_half(jigsaws_dir: Path, trial: str) -> None:
    whole = real_recording(jigsaws_dir, trial)
    for part in whole.hands:
        model = identify_arm([whole.head(min(1240, len(whole)))], part.hand, Identification(), "")
        assert (model.order, model.static) == (0, True)
        assert pytest.approx(0.5 * np.eye(3), abs=0.015) == model.space.D
        assert min(model.fit_pct) > 99.9
        assert 0.7 < model.forecast.damping < 1


def test_an_axis_at_rest_raises_no_doubt() -> None:
    command = hand_like(800, 3)
    follower = 0.5 * command
    follower[:, 2] = 1e-5 * np.random.default_rng(0).normal(size=800)
    training = [recording("T", {"left": (command, follower)})]
    model = identify_arm(training, "left", Identification(), "")
    assert min(model.fit_pct) < 50
    assert not any("may not be the arm" in text for text in model.warnings)


def test_others_of_a_real_task_give_the_same_gain(jigsaws_dir: Path) -> None:
    trainings = [real_recording(jigsaws_dir, f"Suturing_{trial}") for trial in ("C004", "E003", "F003")]
    model = identify_arm(trainings, "left", Identification(train="others"), "")
    assert (model.order, model.static) == (0, True)
    assert pytest.approx(0.5 * np.eye(3), abs=0.002) == model.space.D


@pytest.mark.parametrize("trial", ["Suturing_D002", "Needle_Passing_D003"])
def test_like_named_arms_do_not_follow_and_the_model_says_so(jigsaws_dir: Path, trial: str) -> None:
    whole = real_recording(jigsaws_dir, trial, same_name=True)
    for order in ("auto", 10):
        identification = Identification.model_validate({"order": order})
        model = identify_arm([whole.head(1240)], "left", identification, "")
        assert min(model.fit_pct) < 50
        assert not model.static
        assert model.spectral_radius < 1
        assert any("may not be the arm" in w for w in model.warnings)


@pytest.mark.parametrize("train", ["own_head", "others"])
def test_a_jump_is_not_learned_from(train: str) -> None:
    u, y = lag_pair(1640, 1)
    jumped_y = y.copy()
    jumped_y[500:] += 0.05  # the arm's encoders, say, counted on from another value
    made = recording("T", {"left": (u, jumped_y)})
    identification = Identification.model_validate({"train": train, "order": 3})
    identified = identify_with_orders([made], "left", identification, "")
    model = identified.model
    assert sorted_eigenvalues(model.space.A) == pytest.approx([0.7] * 3, abs=0.05)
    assert markov(model.space, 6) == pytest.approx(markov(ONE_LAG, 6), abs=0.03)
    assert np.sqrt(np.diag(model.noise.R)).max() < 4e-5
    assert (
        "T: trained on rows 0-499, rows 500-1639, as trials of their own, and not on the jumps between"
        in model.warnings
    )
    assert model.trained_on == (RecordedRows("T", "", 0, 1640, 30),)
    assert identified.validation.label == "T rows 500-1639, left hand"
    assert identified.validation.first_row == 500 + 1140 - 342
    truth_m = jumped_y[identified.validation.first_row :] - jumped_y[500:].mean(axis=0)
    assert identified.validation.truth_m == pytest.approx(truth_m)


def test_a_trial_with_missing_rows_is_identified_as_its_halves_are() -> None:
    whole = synthesise(SyntheticSource(kind="synthetic"), 3, 30, 1700, 0)
    u, y = whole.hands[0].command.position_m, whole.hands[0].follower.position_m
    cut_u, cut_y = (np.delete(side, slice(600, 700), axis=0) for side in (u, y))
    wanted = ["innovations_kf", "n4sid_kf", "arx_kf", "direct_ls"]
    model = identify_arm([recording("T", {"left": (cut_u, cut_y)})], "left", Identification(), "", wanted)
    assert model.warnings[0].startswith("T: trained on rows 0-599, rows 600-1599")
    for fitted in (model.innovations, model.n4sid, model.arx, model.direct):
        assert fitted is not None
    # the forecast of the command is that of the two halves: the step over the missing rows is not among its moves
    halves = [
        recording(label, {"left": (u[rows], y[rows])}) for label, rows in (("A", slice(600)), ("B", slice(700, None)))
    ]
    apart = identify_arm(halves, "left", Identification(), "")
    assert model.forecast.growth_m == pytest.approx(apart.forecast.growth_m, rel=1e-9)
