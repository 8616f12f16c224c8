"""Model files with weights: every bit survives, and what is no such file is refused by name."""

import json
import pickle
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from safetensors.numpy import load, save

from tests.patient_side.identification.test_model_file import model
from tests.patient_side.learned.models import LEARNED, learned_model
from tis.common.errors import DataError
from tis.patient_side.identification.model_file import dump_models, is_tensor_file, parse_models, parse_tensors
from tis.patient_side.statespace import ArmModel


def two_hands() -> list[ArmModel]:
    learned = tuple(learned_model(name) for name in LEARNED)
    return [replace(model(), learned=learned), replace(model(hand="right"), learned=(learned_model("cnn", seed=9),))]


DATA = dump_models(two_hands())


def fault_of(data: bytes) -> str:
    with pytest.raises(DataError) as caught:
        parse_models(data, "m.safetensors")
    assert "\n" not in str(caught.value)
    return str(caught.value)


def changed(change: Callable[[Any], None]) -> bytes:
    """The file with its text changed."""
    text, tensors = parse_tensors(DATA, "m")
    raw = json.loads(text)
    change(raw)
    return save(dict(tensors), {"tis": json.dumps(raw)})


def test_every_bit_of_a_learned_model_survives() -> None:
    assert is_tensor_file(DATA)
    before, after = two_hands(), parse_models(DATA, "m.safetensors")
    for ours, theirs in zip(before, after, strict=True):
        assert np.array_equal(ours.space.A, theirs.space.A)
        for one, other in zip(ours.learned, theirs.learned, strict=True):
            assert (one.method, one.version, one.usual_m) == (other.method, other.version, other.usual_m)
            assert np.array_equal(one.covariance_scale, other.covariance_scale)
            assert one.training.held_out == other.training.held_out
            assert np.array_equal(one.training.errors, other.training.errors)
            assert set(one.weights) == set(other.weights)
            assert all(np.array_equal(one.weights[name], other.weights[name]) for name in one.weights)


def test_a_file_without_weights_stays_json() -> None:
    data = dump_models([model()])
    assert not is_tensor_file(data)
    assert json.loads(data)["models"][0]["learned"] == []


@given(share=st.floats(0, 0.999))
def test_a_truncated_file_is_refused(share: float) -> None:
    text = fault_of(DATA[: int(share * len(DATA))])
    assert text.startswith("m.safetensors: ")


def test_a_pickle_is_never_opened() -> None:
    assert "must be JSON or safetensors, and whole" in fault_of(pickle.dumps({"models": []}))


def test_a_foreign_file_of_tensors_is_refused() -> None:
    assert "did not write this file" in fault_of(save({"a": np.zeros(3, dtype=np.float32)}))


def test_a_missing_or_double_precision_tensor_is_named() -> None:
    tensors = {name: np.array(each) for name, each in load(DATA).items()}
    text, _ = parse_tensors(DATA, "m")
    del tensors["cnn.summary.bias"]
    assert "cnn.summary.bias: is missing, and cnn needs it" in fault_of(save(tensors, {"tis": text}))
    doubled = {**tensors, "cnn.summary.bias": np.zeros(48)}
    assert "cnn.summary.bias: must be float32 (got 'float64')" in fault_of(save(doubled, {"tis": text}))


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda part: part.update(method="oracle"), "learned.0.method"),
        (lambda part: part.update(usual_m=0), "learned.0.usual_m"),
        (lambda part: part.update(scale_ages=[3.0, 1.0, 2.0]), "scale_ages must rise"),
        (
            lambda part: part.update(covariance_scale=[[1.0], [1.0]]),
            "mean_share and the rows of covariance_scale must be as long as scale_ages",
        ),
        (lambda part: part.update(mean_share=[1.0, 2.0, 0.0]), "learned.0.mean_share.1"),
        (lambda part: part["training"].update(n_epochs=0), "training.n_epochs"),
        (lambda part: part.update(code="import os"), "learned.0.code"),
    ],
)
def test_a_wrong_part_is_named(change: Callable[[Any], None], text: str) -> None:
    assert text in fault_of(changed(lambda raw: change(raw["models"][0]["learned"][0])))
