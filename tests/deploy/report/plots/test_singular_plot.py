"""The words beside the singular values: which rule chose the order."""

from typing import Any

import pytest

from tests.deploy.report.partial import part
from tis.common.scenario.identification import Identification
from tis.deploy.report.plots.models import singular_figure
from tis.deploy.report.subjects.identification import IdentifiedModel

MODEL: dict[str, Any] = {
    "method": "moesp", "order": 0, "static": True, "singular_values": [3.0, 2.0, 1.0], "fit_pct": [99.99963] * 3,
}  # fmt: skip


@pytest.mark.parametrize(
    ("asked", "method", "words"),
    [
        ({}, "moesp", "Validation chose the order"),
        ({"order": "validation"}, "moesp", "Validation chose the order"),
        ({}, "moesp_paper", "85 % of the sum"),
        ({"order": "energy"}, "moesp", "85 % of the sum"),
        ({"order": "gap"}, "moesp", "the largest drop"),
        ({"order": "criterion"}, "moesp", "An information criterion chose the order"),
        ({"order": 4}, "moesp", "The scenario sets the order"),
        ({"train": "m.json"}, "moesp", "that of the model file"),
    ],
)
def test_the_rule_that_decided_is_named_and_no_floor_is_claimed(
    asked: dict[str, Any], method: str, words: str
) -> None:
    found = singular_figure(part(IdentifiedModel, MODEL | {"method": method}), "left hand", Identification(**asked))
    assert found is not None
    assert words in found.caption
    assert "floor" not in found.caption
    assert "99.999, 99.999, 99.999 %" in found.caption
