"""Fields in which two scenarios differ, with their values, and what another side's message may hold."""

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.common.scenario import Scenario
from tis.common.scenario.reading import (
    MAX_FIELDS,
    agreed_fields,
    apply_settings,
    build_scenario,
    checked_fields,
    differences,
    digest,
    in_words,
)

_RAW: dict[str, Any] = {"version": 1, "name": "s", "source": {"kind": "synthetic"}}


def _scenario(*settings: str) -> Scenario:
    return build_scenario(apply_settings(_RAW, settings), "s")


def _words(here: Scenario, there: Scenario) -> str:
    return in_words(differences(agreed_fields(here), agreed_fields(there)))


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("duration_s=4", "duration_s is 4.0 there, 20.0 here"),
        ("name=other", 'name is "other" there, "s" here'),
        ("estimators=[hold, innovations_kf, moesp_kf]", "estimators is "),
        ("network.forward.loss={kind: bernoulli, p_loss: 0.1}", "network.forward.loss.kind is "),
        ("surgeon.copies=2", "surgeon.copies is 2 there, 1 here"),
    ],
)
def test_a_field_that_differs_is_named_with_both_values(setting: str, words: str) -> None:
    assert words in _words(_scenario(), _scenario(setting))


@pytest.mark.parametrize(
    "settings",
    [
        (),
        ("hosts={west: tls/10.0.0.1:1, east: tls/10.0.0.2:2}", "security={kind: mtls, folder: /secret/place}"),
        ("seed=2",),
        ("network.forward.delay={kind: constant, delay_ms: 3}", "rate_hz=50"),
        ("on_peer_loss=end", "peer_timeout_s=3"),
        ("patient.tick_phase_ms=1",),
    ],
)
def test_fields_differ_exactly_where_digests_do(settings: tuple[str, ...]) -> None:
    here, there = _scenario(), _scenario(*settings)
    assert bool(_words(here, there)) == (digest(here) != digest(there))


def test_what_may_differ_is_not_among_the_fields() -> None:
    security = "security={kind: mtls, folder: /secret/place}"
    fields = agreed_fields(_scenario("hosts={west: tls/h:1, east: tls/h:2}", security))
    assert "secret" not in json.dumps(fields)
    assert fields["security.kind"] == '"mtls"'


def test_a_long_value_is_a_hash_and_many_differences_are_counted() -> None:
    here = {"list": "#00", "a": "1", "b": "2", "c": "3", "d": "4", "e": "5", "same": "6"}
    there = {"list": "#01", "a": "2", "b": "3", "c": "4", "d": "5", "same": "6", "new": "7"}
    assert in_words(differences(here, there)) == (
        "list differs; a is 2 there, 1 here; b is 3 there, 2 here; c is 4 there, 3 here; and 3 more"
    )
    words = in_words(differences({"e": "5"}, {"new": "7"}))
    assert words == "e is not given there, 5 here; new is 7 there, not given here"
    fields = agreed_fields(_scenario(f"name={'x' * 60}"))
    assert fields["name"].startswith("#")
    assert all(len(value) <= 60 for value in fields.values())


def test_the_fields_of_a_scenario_pass_the_check_of_the_other_side() -> None:
    fields = agreed_fields(_scenario())
    assert 50 < len(fields) < MAX_FIELDS
    assert checked_fields(json.dumps(fields).encode()) == fields


@pytest.mark.parametrize(
    "found",
    [
        [],
        {"a": 1},
        {"a b": "1"},
        {"a": "x" * 61},
        {"a": "\x1b[2J"},
        {"a" * 201: "1"},
        {str(n): "1" for n in range(5000)},
    ],
)
def test_a_message_of_another_form_is_none(found: Any) -> None:
    assert checked_fields(json.dumps(found).encode()) is None


@given(st.binary(max_size=100))
def test_bytes_of_anybody_are_fields_or_none(payload: bytes) -> None:
    found = checked_fields(payload)
    assert found is None or json.loads(payload) == found


def test_deep_nesting_is_none() -> None:
    assert checked_fields(b"[" * 100_000) is None
