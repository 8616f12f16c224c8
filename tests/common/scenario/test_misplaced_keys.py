"""Keys in a wrong place: where they belong."""

import pytest
from pydantic import ValidationError

from tis.common.errors import InputError
from tis.common.scenario import Scenario
from tis.common.scenario.faults import faults, misplaced_key_hint
from tis.common.scenario.network import NetworkPart
from tis.common.scenario.reading import build_scenario


@pytest.mark.parametrize(
    ("path", "hint"),
    [
        ("patient.estimators", "'estimators' at the top level"),
        ("patient.estimatrs", "'estimators' at the top level"),
        ("order", "'identification.order'"),
        ("patient.train_sample", "'identification.train_samples'"),
        ("network.loss", "'network.forward.loss' or 'network.feedback.loss'"),
        # a key of one kind of a stage
        ("network.mean_burst", "'network.forward.loss.mean_burst' or 'network.feedback.loss.mean_burst'"),
        # a key of an alternative that is told apart by no kind
        ("west", "'hosts.west'"),
    ],
)
def test_the_place_is_named(path: str, hint: str) -> None:
    assert misplaced_key_hint(tuple(path.split(".")), Scenario) == f", did you mean {hint}?"


@pytest.mark.parametrize(
    "path",
    [
        "fnord",
        "kind",  # stands nearly everywhere
        "network.forward.delay.mean_ms",  # is there already, for delays of another kind
        "network.rules.0.fnord",
    ],
)
def test_where_nothing_can_be_told_nothing_is(path: str) -> None:
    assert misplaced_key_hint(tuple(path.split(".")), Scenario) == ""


def test_every_place_that_is_named_is_a_key() -> None:
    """The oracle is the validation itself: at the places that hints name nothing is unknown."""
    raw = {"version": 1, "name": "s", "source": {"kind": "synthetic"}}
    with pytest.raises(InputError) as caught:
        build_scenario(raw | {"patient": {"train_samples": 90, "copies": 2}}, "s.yaml")
    assert [str(fault) for fault in caught.value.faults] == [
        "s.yaml: patient.train_samples: unknown key, did you mean 'identification.train_samples'? (got 90)",
        "s.yaml: patient.copies: unknown key, did you mean 'surgeon.copies'? (got 2)",
    ]
    found = build_scenario(raw | {"identification": {"train_samples": 90}, "surgeon": {"copies": 2}}, "s.yaml")
    assert (found.identification.train_samples, found.surgeon.copies) == (90, 2)


@pytest.mark.parametrize("name", ["max_ms", "max_delay_ms", "limit_ms"])
def test_a_queue_of_so_many_ms_is_told_in_bytes(name: str) -> None:
    """Oracle: 250 ms at 5000 kbit/s are 1 250 000 bit."""
    rate = {"kbit_s": 5000, "queue": {"kind": "tail_drop", name: 250}}
    with pytest.raises(ValidationError) as caught:
        NetworkPart.model_validate({"forward": {"rate": rate}})
    (fault,) = faults(caught.value, NetworkPart, "x")
    assert "did you mean max_bytes? A queue of so many ms has ms x kbit_s / 8" in str(fault)
    assert 250 * 5000 // 8 == 156_250
    assert "(250 ms at 5000 kbit/s: 156250)" in str(fault)
