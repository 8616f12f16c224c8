from collections.abc import Callable
from math import atan, cbrt, expm1

import pytest

from netem.stages.delay.crossing import crossing


@pytest.mark.parametrize(
    ("f", "root"),
    [
        (lambda x: x - 3.5, 3.5),
        (lambda x: cbrt(x - 2), 2.0),
        (lambda x: atan(1e6 * (x - 7.25)), 7.25),
        (lambda x: expm1(50 * (x - 9)), 9.0),
        (lambda x: -1.0 if x < 6.5 else 1.0, 6.5),
        (lambda x: (x - 9) ** 9, 9.0),  # false position alone crawls
        (lambda x: x - 10.0, 10.0),
        (lambda x: x, 0.0),
    ],
)
def test_the_crossing_is_found_in_few_steps(f: Callable[[float], float], root: float) -> None:
    calls = []

    def counted(x: float) -> float:
        calls.append(x)
        return f(x)

    assert crossing(counted, 0.0, 10.0, 1e-9) == pytest.approx(root, abs=1e-9)
    assert len(calls) < 120
    assert all(0 <= x <= 10 for x in calls)
