"""Arbitrary and mutated bytes: each decoder returns, or raises only what it documents."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.fuzz.decoders import DECODERS, decode
from tests.fuzz.mutations import mutated

SLOW = (
    "foreign MCAP",
    "Parquet table",
    "table text",
    "MCAP file",
    "scenario",
    "profile",
    "study",
    "JIGSAWS text",
    "model",
)


@pytest.mark.parametrize("name", DECODERS)
def test_valid_samples_are_decoded(name: str) -> None:
    for sample in DECODERS[name].samples:
        DECODERS[name].decode(sample)


@pytest.mark.parametrize("name", DECODERS)
def test_any_bytes_are_decoded_or_refused(name: str) -> None:
    @settings(max_examples=20 if name in SLOW else 60, database=None)
    @given(data=st.binary(max_size=120))
    def holds(data: bytes) -> None:
        decode(name, data)

    holds()


@pytest.mark.parametrize("name", DECODERS)
def test_mutated_samples_are_decoded_or_refused(name: str) -> None:
    @settings(max_examples=30 if name in SLOW else 100, database=None)
    @given(seed=st.integers(0, 2**32), which=st.integers(0, 9))
    def holds(seed: int, which: int) -> None:
        samples = DECODERS[name].samples
        decode(name, mutated(samples[which % len(samples)], random.Random(seed)))

    holds()
