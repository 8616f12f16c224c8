import dataclasses
import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.patient_side.arm_models import completion_model, direct_model, slow_movement
from tests.patient_side.filters.test_correction import correction
from tests.patient_side.orientation.test_no_leak import model as wrist_model
from tis.common.channels import Hand
from tis.common.errors import DataError
from tis.common.sources.provenance import RecordedRows
from tis.patient_side.identification.model_file import dump_models, parse_models
from tis.patient_side.linear_system import NoiseModel, StateSpace
from tis.patient_side.movement_models import Head, InputForecast
from tis.patient_side.statespace import ArmModel, FilterModel


def model(order: int = 2, hand: Hand = "left", seed: int = 0) -> ArmModel:
    rng = np.random.default_rng(seed)
    spread = 10.0 ** rng.integers(-12, 12)

    def some(*shape: int) -> np.ndarray[Any, np.dtype[np.float64]]:
        return np.asarray(spread * rng.normal(size=shape) / 3)

    root = some(3, 3)
    return ArmModel(
        hand=hand,
        arm="PSM2",
        rate_hz=30,
        method="moesp",
        order=order,
        block_rows=10,
        train="own_head",
        space=StateSpace(some(order, order), some(order, 3), some(3, order), some(3, 3)),
        x0=some(order),
        noise=NoiseModel(some(order, order), root @ root.T + spread**2 * np.eye(3), some(order, 3)),
        forecast=InputForecast(0.927, 2, some(5, 3), 0.989),
        input_offset_m=some(3),
        output_offset_m=some(3),
        output_low_m=some(3),
        output_high_m=some(3),
        singular_values=some(30),
        fit_pct=(99.9999999, -614.25, 0.1 + 0.2),
        spectral_radius=0.1 + 0.7,
        pairing="crossed: 'µ' = 15 um",
        static=order == 0,
        warnings=("one", "two"),
        trained_on=(RecordedRows("Suturing_B001", "0a1b", 0, 900, 30), RecordedRows("µ", "", 7, 1, 30))[:order],
        **beside(order, rng),
    )


def beside(order: int, rng: np.random.Generator) -> dict[str, Any]:
    """Return what some estimators need beside the model, all of it or nothing."""
    if order % 2:
        return {}
    own = FilterModel(
        StateSpace(*(rng.normal(size=shape) for shape in ((1, 1), (1, 3), (3, 1), (3, 3)))),
        NoiseModel(np.eye(1), np.diag([1e-9, 2e-9, 1e-12]), rng.normal(size=(1, 3))),
        rng.normal(size=3),
        rng.normal(size=3),
        static=False,
    )
    static = FilterModel(
        StateSpace(np.zeros((0, 0)), np.zeros((0, 3)), np.zeros((3, 0)), rng.normal(size=(3, 3))),
        NoiseModel(np.zeros((0, 0)), np.eye(3) / 3, np.zeros((0, 3))),
        rng.normal(size=3),
        rng.normal(size=3),
        static=True,
    )
    return {
        "n4sid": own,
        "arx": static,
        "autoregression": slow_movement(),
        "innovations": dataclasses.replace(
            slow_movement(), integrated=order > 0, isotropic=True, correction=correction(7)
        ),
        "direct": direct_model(),
        "drmf": completion_model(),
    }


def assert_same(one: object, other: object) -> None:
    assert type(one) is type(other)
    if dataclasses.is_dataclass(one):
        for field in dataclasses.fields(one):
            assert_same(getattr(one, field.name), getattr(other, field.name))
    elif isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        assert one.dtype == other.dtype
        assert one.shape == other.shape
        assert one.tobytes() == other.tobytes()
    else:
        assert one == other


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 6), st.integers(0, 2**32 - 1))
def test_every_bit_survives_the_round_trip(order: int, seed: int) -> None:
    before = model(order, seed=seed)
    (after,) = parse_models(dump_models([before]), "m.json")
    assert_same(before, after)


def test_a_file_without_training_rows_is_read_and_damaged_ones_are_rejected() -> None:
    raw = json.loads(dump_models([model(2)]))
    del raw["models"][0]["trained_on"]
    assert parse_models(json.dumps(raw).encode(), "m.json")[0].trained_on == ()

    def change(raw: Any) -> None:
        raw["models"][0]["trained_on"][0] |= {"n_rows": 0, "first_row": -1}

    assert faults(change) == [
        "m.json: models.0.trained_on.0.first_row: must be greater than or equal to 0 (got -1)",
        "m.json: models.0.trained_on.0.n_rows: must be greater than or equal to 1 (got 0)",
    ]


def test_two_hands_share_a_file() -> None:
    models = (model(0), model(3, "right", 1))
    for before, after in zip(models, parse_models(dump_models(models), "m.json"), strict=True):
        assert_same(before, after)


def faults(change: Callable[[Any], object]) -> list[str]:
    raw = json.loads(dump_models([model()]))
    change(raw)
    with pytest.raises(DataError) as caught:
        parse_models(json.dumps(raw).encode(), "m.json")
    assert caught.value.exit_code == 4
    return [str(fault) for fault in caught.value.faults]


def test_shapes_are_checked_against_the_order_all_at_once() -> None:
    def change(raw: Any) -> None:
        raw["models"][0]["order"] = 3
        raw["models"][0]["noise"]["R"] = [[1.0]]

    (fault,) = faults(change)
    for text in ("space.A must have the shape (3, 3)", "noise.R must have the shape (3, 3)", "x0 must have 3 el"):
        assert text in fault
    assert fault.startswith("m.json: models.0: ")


def test_a_correction_is_checked_as_a_whole() -> None:
    def change(raw: Any) -> None:
        part = raw["models"][0]["innovations"]["correction"]
        part["horizons"], part["weights"][0], part["lowest"] = [4.0, 1.0, 9.0], [[1.0]], 3.0
        part["widths"], part["fourier"][1] = part["widths"][:2], [[1.0]]
        part["centre"] = part["centre"][:3]

    (fault,) = faults(change)
    for text in (
        "weights must have the shape (3, 8, 15)",
        "fourier must have the shape (3, 3, 5)",
        "widths must have 6 elements",
        "centre and deviation must have 20 elements",
        "horizons must rise",
        "lowest must be at most highest",
    ):
        assert text in fault


def test_heads_of_the_former_form_are_left_out_with_a_warning() -> None:
    heads = [Head(np.zeros(n), np.ones(n), np.zeros((3, 3, 4))) for n in (36, 58)]
    innovations = replace(slow_movement(), correction=replace(correction(), heads=heads))
    (read,) = parse_models(dump_models([replace(model(), innovations=innovations)]), "m.json")
    assert read.innovations is not None
    assert read.innovations.correction is not None
    assert not read.innovations.correction.heads
    assert "train it again" in read.warnings[-1]


def test_a_correction_without_fourier_features_keeps_its_shapes() -> None:
    part = dataclasses.replace(slow_movement(), correction=correction(1, n_features=0))
    (back,) = parse_models(dump_models([dataclasses.replace(model(), innovations=part)]), "m.json")
    assert back.innovations is not None
    assert back.innovations.correction is not None
    assert back.innovations.correction.fourier.shape == (3, 3, 0)


def test_every_fault_of_a_file_is_reported() -> None:
    def change(raw: Any) -> None:
        raw["version"] = 2
        raw["models"][0]["hand"] = "middle"
        raw["models"][0]["forecast"]["damping"] = 1.5
        raw["models"][0]["space"]["A"][0][0] = float("nan")
        raw["models"][0]["extra"] = 1
        del raw["models"][0]["arm"]

    found = "\n".join(faults(change))
    for text in (
        "m.json: version: must be 1 (got 2)",
        "models.0.hand: must be 'left' or 'right' (got 'middle')",
        "models.0.forecast.damping: must be less than or equal to 1 (got 1.5)",
        "models.0.space.A.0.0: must be a finite number (got nan)",
        "models.0.extra: Extra inputs are not permitted (got 1)",
        "models.0.arm: Field required",
    ):
        assert text in found


def test_a_hand_must_not_come_back_as_quickly_as_it_slows() -> None:
    def change(raw: Any) -> None:
        raw["models"][0]["forecast"] |= {"damping": 0.99, "persistence": 0.99}

    assert "forecast: damping must be at most 2 persistence - 1" in faults(change)[0]


@pytest.mark.parametrize("entry", [[0.0, -1.0], [1e-9, 1.0]])
def test_measurement_noise_must_be_a_covariance(entry: list[float]) -> None:
    def change(raw: Any) -> None:
        raw["models"][0]["noise"]["R"][0][:2] = entry

    assert "noise.R must be symmetric and positive definite" in faults(change)[0]


def test_what_stands_beside_the_model_is_checked_too() -> None:
    def change(raw: Any) -> None:
        model = raw["models"][0]
        model["n4sid"]["space"]["B"] = [[1.0]]
        model["arx"]["noise"]["R"] = [[0.0] * 3] * 3
        model["autoregression"]["K"].pop()
        model["direct"]["penalty"].pop()
        model["direct"]["lags"][0] = 99
        model["drmf"]["factorisation"]["rank"] = 19
        model["drmf"]["longest"] = 20
        model["drmf"]["horizons"] = [1, 5, 5]
        model["drmf"]["covariance_m2"].pop()

    found = "\n".join(faults(change))
    for text in (
        "models.0.n4sid: space.B must have the shape (1, 3)",
        "models.0.arx: noise.R must be symmetric and positive definite",
        "models.0.autoregression: K must have the shape (6, 3)",
        "penalty must have",
        "lags and horizons must rise",
        "models.0.drmf: factorisation.rank must be at most 18",
        "longest must be below 20",
        "horizons must rise; covariance_m2 must have 3 elements",
    ):
        assert text in found


def test_one_or_two_models_of_different_hands() -> None:
    assert "at least 1 item" in faults(lambda raw: raw["models"].clear())[0]
    assert "different hands, not twice left" in faults(lambda raw: raw["models"].append(raw["models"][0]))[0]


@pytest.mark.parametrize("text", ["", "{", "[1, 2]", "null", '"model"', "[" * 100_000])
def test_what_is_no_model_file_is_one_line_without_a_traceback(text: str) -> None:
    with pytest.raises(DataError) as caught:
        parse_models(text.encode(), "m.json")
    assert str(caught.value).startswith("m.json: ")
    assert "\n" not in str(caught.value)


def test_the_models_of_a_wrist_come_back_bit_for_bit() -> None:
    wrist = wrist_model()
    one = dataclasses.replace(model(), wrist=wrist)
    (other,) = parse_models(dump_models([one]), "m.json")
    assert dump_models([other]) == dump_models([one])
    assert other.wrist is not None
    for left, right, axes in (
        (other.wrist.direct, wrist.direct, 3),
        (other.wrist.gripper_direct, wrist.gripper_direct, 1),
    ):
        assert left is not None
        assert right is not None
        assert np.array_equal(left.cross, right.cross)
        assert left.axes == axes


def test_a_file_with_the_rates_of_a_former_method_serves_without_them() -> None:
    raw = json.loads(dump_models([dataclasses.replace(model(), wrist=wrist_model())]))
    raw["models"][0]["wrist"] |= {"rate": {"stride": 1}, "gripper_rate": None}
    (found,) = parse_models(json.dumps(raw).encode(), "m.json")
    assert found.wrist is not None
    assert found.wrist.serves("tangent_ls")


@pytest.mark.parametrize(
    ("place", "value", "rule"),
    [
        (("gripper_direct",), None, "direct and gripper_direct must both be given, or neither"),
        (("gripper_direct", "stride"), 2, "must have the same stride and lags"),
        (("gripper_direct", "past"), [[1.0]], "past must have the shape (21, 21)"),
        (("direct", "unheard_of"), 1, "Extra inputs are not permitted"),
    ],
)
def test_a_wrist_that_is_not_sound_is_refused(place: tuple[str, ...], value: Any, rule: str) -> None:
    raw = json.loads(dump_models([dataclasses.replace(model(), wrist=wrist_model())]))
    part = raw["models"][0]["wrist"]
    for step in place[:-1]:
        part = part[step]
    part[place[-1]] = value
    with pytest.raises(DataError) as caught:
        parse_models(json.dumps(raw).encode(), "m.json")
    assert rule in str(caught.value)
    assert "wrist" in str(caught.value)
