from typing import Any

import pytest
from pydantic import TypeAdapter, ValidationError

from tis.common.scenario.network.delay import Delay

DELAY: TypeAdapter[Any] = TypeAdapter(Delay)

LOGNORMAL = {"kind": "lognormal", "mean_ms": 5, "std_ms": 3}
PARETO = {"kind": "pareto", "scale_ms": 5, "shape": 0.5}
HYPEREXPONENTIAL = {"kind": "hyperexponential", "weights": [0.5, 0.5], "means_ms": [2, 8]}


@pytest.mark.parametrize(
    "part",
    [
        LOGNORMAL | {"max_ms": 5},
        LOGNORMAL | {"shift_ms": 10, "max_ms": 15},
        {"kind": "gamma", "mean_ms": 1e-6, "std_ms": 3.6e6},
        PARETO | {"max_ms": 5},
        PARETO | {"shape": 0.05},
        HYPEREXPONENTIAL | {"max_ms": 5},
        {"kind": "quantiles", "points": [{"p": 0, "delay_ms": 3}, {"p": 1, "delay_ms": 3}]},
        {"kind": "trace", "path": "a.csv"},
    ],
)
def test_what_can_be_drawn_is_accepted(part: dict[str, Any]) -> None:
    assert DELAY.validate_python(part).kind == part["kind"]


@pytest.mark.parametrize(
    ("part", "words"),
    [
        (LOGNORMAL | {"max_ms": 4.9}, "max_ms must be at least 5, or nearly all delays would be redrawn"),
        (LOGNORMAL | {"shift_ms": 3_599_999}, "max_ms must be at least 3.6e+06"),
        (PARETO | {"shift_ms": 1, "max_ms": 5}, "max_ms must be at least 6"),
        (HYPEREXPONENTIAL | {"max_ms": 4}, "max_ms must be at least 5"),
        (HYPEREXPONENTIAL | {"weights": [0.5, 0.4]}, "weights must sum to 1"),
        (HYPEREXPONENTIAL | {"means_ms": [2]}, "means_ms must have as many items as weights, 2"),
        (PARETO | {"shape": 0.01}, "greater than or equal to 0.05"),
        (LOGNORMAL | {"std_ms": 0}, "greater than or equal to 0.000001"),
        ({"kind": "gamma", "mean_ms": 0, "std_ms": 1}, "greater than or equal to 0.000001"),
        ({"kind": "quantiles", "points": [{"p": 0, "delay_ms": 3}, {"p": 0.9, "delay_ms": 4}]}, "end at p = 1"),
        (
            {"kind": "quantiles", "points": [{"p": 0, "delay_ms": 3}, {"p": 1, "delay_ms": 2}]},
            "points must have strictly ascending p and no descending delay_ms",
        ),
    ],
)
def test_what_cannot_be_drawn_is_refused(part: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError) as caught:
        DELAY.validate_python(part)
    assert words in str(caught.value)
