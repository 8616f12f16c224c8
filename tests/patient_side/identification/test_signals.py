"""The call shape of all identification methods: what may be handed over, and what is refused."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tis.common.errors import DataError
from tis.patient_side.identification import arx, narx, stochastic_moesp
from tis.patient_side.identification.linear_model import as_trials
from tis.patient_side.identification.subspace_methods import METHODS as BY_NAME
from tis.patient_side.linear_system import Array

Identify = Callable[..., Any]
METHODS = pytest.mark.parametrize(
    "identify",
    [
        BY_NAME["moesp"],
        BY_NAME["pi_moesp"],
        BY_NAME["n4sid"],
        BY_NAME["cva"],
        arx.identify,
        narx.identify,
        stochastic_moesp.identify,
    ],
)


def driven(n_rows: int = 200) -> tuple[Array, Array]:
    """y[k+1] = 0.8 y[k] + u[k] + e, two of them."""
    rng = np.random.default_rng(4)
    u, y = rng.normal(size=(n_rows, 2)), np.zeros((n_rows, 2))
    for k in range(1, n_rows):
        y[k] = 0.8 * y[k - 1] + u[k - 1] + 0.1 * rng.normal(size=2)
    return u, y


def refusal(identify: Identify, *call: object) -> list[str]:
    with pytest.raises(DataError) as caught:
        identify(*call)
    return [str(fault) for fault in caught.value.faults]


@METHODS
def test_plain_lists_and_single_precision_are_arrays_too(identify: Identify) -> None:
    u, y = driven()
    rounded = u.astype(np.float32), y.astype(np.float32)
    expected = identify(*(part.astype(float) for part in rounded), 2, 4)
    for call in (rounded, [part.tolist() for part in rounded], [[part.tolist()] for part in rounded]):
        found = identify(*call, 2, 4)
        if identify is narx.identify:
            assert found.terms == expected.terms
        else:
            assert np.array_equal(found.space.A, expected.space.A)
            assert found.space.A.dtype == float


@METHODS
@pytest.mark.parametrize("order", [2.0, "auto", None, True])
def test_an_order_is_a_whole_number(identify: Identify, order: object) -> None:
    assert refusal(identify, *driven(), order, 0) == [
        f"identification: order: must be an integer (got {order!r})",
        "identification: horizon: must be an integer, 1 or more (got 0)",
    ]


@METHODS
def test_what_is_masked_complex_or_text_is_refused(identify: Identify) -> None:
    u, y = driven()
    masked = np.ma.masked_array(y, np.abs(y) > 100)
    masked[7, 1] = np.ma.masked
    assert refusal(identify, u, masked, 2, 4) == [
        "trial 1: output: must be finite: 1 values are not, the first in row 7"
    ]
    for wrong in (y + 0j, [["a", "b"]] * len(y), [y[:9].tolist(), [1.0, "b"]], 3.0, None):
        assert refusal(identify, u, wrong, 2, 4) == [
            "identification: output: must be an array (samples, channels) of real numbers, or a sequence of them, one"
            " for each trial"
        ]


def test_outputs_alone_have_no_faults_of_inputs() -> None:
    _, y = driven()
    still = np.column_stack([y[:, 0], np.full(len(y), 0.2)])
    assert refusal(stochastic_moesp.identify, None, still, 2, 4) == [
        "identification: output 1: must move, it is constant in the training rows: "
        "at rest it needs sensor_noise_mm: 0.01"
    ]


def test_arrays_of_floats_are_taken_as_they_are() -> None:
    u, y = driven()
    [(inputs, outputs)] = as_trials(u, y)
    assert inputs is u
    assert outputs is y
