import numpy as np
import pytest

from tests.patient_side.identification.known_systems import Array, hand_like, markov, recording
from tis.common.errors import DataError
from tis.common.scenario.identification import Identification
from tis.patient_side.identification.identify import identify_arm, identify_with_orders
from tis.patient_side.identification.model_file import dump_models, parse_models
from tis.patient_side.identification.moesp_paper import empirical_noise, paper_model, paper_subspace
from tis.patient_side.linear_system import StateSpace

SETTLING = StateSpace(
    np.diag([0.9, 0.6, 0.75]),
    np.diag([0.05, 0.2, 0.125]) @ [[1, 0.2, 0], [0, 1, 0], [0.1, 0, 1]],
    np.eye(3),
    0.1 * np.eye(3),
)


def pair(n_rows: int, seed: int = 0) -> tuple[Array, Array]:
    u = hand_like(n_rows, seed) + 0.2 * np.random.default_rng(seed).normal(size=(n_rows, 3)) + [0.1, -0.4, 0.0]
    return u, SETTLING.simulate(u) + np.array([0.3, 0.0, -0.2])


def paper(order: int | str = "auto", block_rows: int = 5, **more: float) -> Identification:
    return Identification.model_validate({"method": "moesp_paper", "order": order, "block_rows": block_rows, **more})


def test_the_model_is_in_metres_about_the_lower_ends_of_the_ranges() -> None:
    u, y = pair(600)
    model = identify_arm([recording("T", {"left": (u, y)})], "left", paper(4), "")
    assert np.array_equal(model.input_offset_m, u.min(axis=0))
    assert np.array_equal(model.output_offset_m, y.min(axis=0))
    assert np.array_equal(model.output_offset_m, model.output_low_m)
    # three states and the one that holds the offset
    assert markov(model.space, 15) == pytest.approx(markov(SETTLING, 15), abs=1e-8)
    assert np.max(np.abs(np.linalg.eigvals(model.space.A))) == pytest.approx(1.0, abs=1e-9)
    assert min(model.fit_pct) > 99.999
    assert (model.method, model.static, model.x0.tolist()) == ("moesp_paper", False, [0.0] * 4)


def test_noise_is_the_papers_in_normalised_units_and_then_in_metres() -> None:
    rng = np.random.default_rng(5)
    u, y = pair(500)
    y = y + 1e-3 * rng.normal(size=y.shape)
    model = identify_arm([recording("T", {"left": (u, y)})], "left", paper(3, epsilon_q=2e-3, epsilon_r=5e-3), "")
    range_m = np.ptp(y, axis=0)
    trial = ((u - u.min(axis=0)) / np.ptp(u, axis=0), (y - y.min(axis=0)) / range_m)
    space = paper_model(paper_subspace([trial], 5)[0], 3)
    wanted = empirical_noise(space, [trial], 2e-3, 5e-3)
    assert pytest.approx(wanted.Q) == model.noise.Q
    assert pytest.approx(np.diag(range_m) @ wanted.R @ np.diag(range_m)) == model.noise.R
    assert not model.noise.S.any()


def test_auto_takes_the_energy_rules_order_and_reports_all_three() -> None:
    u, y = pair(800)
    identified = identify_with_orders([recording("T", {"left": (u, y)})], "left", paper(), "")
    values = identified.model.singular_values
    share = np.cumsum(values) / values.sum()
    assert identified.model.order == identified.orders.energy == int(np.argmax(share >= 0.85)) + 1
    assert identified.orders.log_gap == 4
    given = identify_with_orders([recording("T", {"left": (u, y)})], "left", paper(2), "")
    assert given.model.order == 2
    assert given.orders == identified.orders


def test_the_validation_run_is_of_the_rows_that_the_model_was_not_fitted_on() -> None:
    u, y = pair(600)
    run = identify_with_orders([recording("T", {"left": (u, y)})], "left", paper(4), "").validation
    assert (run.label, run.first_row, run.n_start) == ("T, left hand", 420, 10)
    assert run.truth_m == pytest.approx(y[420:] - y.min(axis=0))
    assert run.simulated_m == pytest.approx(run.truth_m, abs=1e-7)


def test_of_several_trials_one_range_is_taken() -> None:
    trainings = [recording(f"T{i}", {"left": pair(300, i), "right": pair(300, 5 + i)}) for i in range(2)]
    model = identify_arm(trainings, "right", paper(4).model_copy(update={"train": "others"}), "")
    lowest = np.min([part.follower.position_m.min(axis=0) for r in trainings for part in r.hands], axis=0)
    assert np.array_equal(model.output_offset_m, lowest)
    assert markov(model.space, 15) == pytest.approx(markov(SETTLING, 15), abs=1e-7)


def test_every_bit_survives_a_model_file() -> None:
    model = identify_arm([recording("T", {"left": pair(600)})], "left", paper(4), "crossed")
    (again,) = parse_models(dump_models([model]), "m.json")
    for name in "ABCD":
        assert np.array_equal(getattr(again.space, name), getattr(model.space, name))
    assert np.array_equal(again.noise.Q, model.noise.Q)
    assert np.array_equal(again.noise.R, model.noise.R)
    assert (again.method, again.order, again.fit_pct) == ("moesp_paper", 4, model.fit_pct)


def refusal(u: Array, y: Array, identification: Identification) -> list[str]:
    with pytest.raises(DataError) as caught:
        identify_arm([recording("T", {"left": (u, y)})], "left", identification, "")
    lines = str(caught.value).splitlines()
    assert len(lines) == len(caught.value.faults)  # each is one line
    return lines


def test_what_cannot_be_identified_from_is_refused_in_one_line() -> None:
    u, y = pair(400)
    broken = y.copy()
    broken[7, 1] = np.nan
    still = y * [1.0, 0.0, 1.0]
    t = np.arange(400.0)[:, None]
    wave = np.hstack([np.sin(0.3 * t), np.sin(0.5 * t), np.sin(0.8 * t)])
    assert refusal(u, broken, paper()) == [
        "T, left hand: output: must be finite: 1 values are not, the first in row 7"
    ]
    assert refusal(u, still, paper()) == [
        "identification: output 1: must move, it is constant in the training rows: "
        "at rest it needs sensor_noise_mm: 0.01"
    ]
    assert refusal(u.T[:2, :3], y.T[:2, :3], paper())[0].endswith("too short, or transposed (got (2, 3))")
    assert refusal(wave, y, paper())[0].startswith("identification: input: must be persistently exciting: its Hankel")
    assert refusal(u, u @ np.diag([0.5, 0.4, 0.3]), paper()) == [
        "identification: order: moesp_paper finds no state: the inputs of the same stretch explain the outputs;"
        " use method moesp"
    ]
    for order in (0, 13):
        assert refusal(u, y, paper(order)) == [
            f"identification: order: must lie in 1..12, (block rows - 1) x outputs (got {order})"
        ]


def test_one_set_of_block_rows_needs_half_the_rows_and_names_them() -> None:
    # 5 block rows of 6 signals: 30 columns in N - 4 rows, of which 30 % are set aside: 34 of 48
    assert refusal(*pair(47), paper(3)) == [
        "identification: training rows: 5 block rows, 3 inputs and 3 outputs need 48 rows in one trial, 30 % of them"
        " to validate on: 30 Hankel columns, here 29 (got 47)"
    ]
    identify_arm([recording("T", {"left": pair(48)})], "left", paper(3), "")


def test_an_energy_rule_that_asks_for_more_than_the_shift_shows_is_cut_and_says_so() -> None:
    rng = np.random.default_rng(6)
    noise = (rng.normal(size=(400, 3)), rng.normal(size=(400, 3)))
    model = identify_arm([recording("T", {"left": noise})], "left", paper(block_rows=2), "")
    assert model.order == 3
    assert any("takes 5 states, 2 block rows show 3: these are used" in w for w in model.warnings)


def test_beside_a_model_about_the_mean_the_papers_stays_about_the_lower_ends() -> None:
    u, y = pair(600)
    model = identify_arm([recording("T", {"left": (u, y)})], "left", Identification(), "", ["paper", "n4sid_kf"])
    assert model.paper is not None
    assert model.n4sid is not None
    assert np.array_equal(model.paper.input_offset_m, u.min(axis=0))
    assert np.array_equal(model.paper.output_offset_m, y.min(axis=0))
    assert np.array_equal(model.n4sid.output_offset_m, model.output_offset_m)
