"""Keys in a wrong place: where they belong."""

import pytest

from tis.common.errors import InputError
from tis.common.scenario import Scenario
from tis.common.scenario.faults import misplaced_key_hint
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
