"""Steps that the tests put in are found with their period and their values; what only resembles them is not."""

import numpy as np
import pytest

from tests.netem.fit.synthetic_records import Parameters, record
from tis.common.trace import LOST, Trace
from tis.netem.fit.steps import find_steps

OF = Parameters(seconds=300, rate_hz=50)


@pytest.mark.parametrize("seed", range(4))
def test_steps_of_a_satellite_are_found_and_taken_out(seed: int) -> None:
    trace = record("steps", OF, seed)
    found = find_steps(trace)
    assert found is not None
    assert found.process["every_s"] == pytest.approx(15, abs=0.02)
    assert 20 <= len(found.values_ms) <= 21
    assert found.values_ms.max() == pytest.approx(30, abs=5)
    rest = found.removed_from(trace)
    kept = trace.delay_ns >= 0
    assert np.array_equal(rest.delay_ns < 0, ~kept)
    # the lognormal part alone has a deviation of 5 ms
    assert rest.delay_ns[kept].std() / 1e6 == pytest.approx(5, abs=0.6)


@pytest.mark.parametrize("name", ["bursts", "outages", "bad_states", "stalls", "bufferbloat"])
@pytest.mark.parametrize("seed", range(3))
def test_other_processes_have_no_steps(name: str, seed: int) -> None:
    assert find_steps(record(name, OF, seed)) is None


@pytest.mark.parametrize("n", [2, 50, 5000])
def test_short_lost_and_constant_records_have_none(n: int) -> None:
    sent_ns = np.arange(n) * 20_000_000
    for delay_ns in (np.full(n, LOST), np.full(n, 5_000_000)):
        assert find_steps(Trace("t", sent_ns, delay_ns)) is None
