"""One direction of records made by numpy: what is constant, what is too short, what is known beside delays."""

from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from tis.common.scenario.network.pipeline import Pipeline
from tis.common.trace import LOST, Trace
from tis.netem.fit.direction import MIN_RECEIVED, DirectionFit, fit_direction
from tis.netem.fit.record import NOTHING_ADDED, DirectionRecord, Flips, Spread

US, MS = 1_000, 1_000_000


def fitted(delay_ns: Any, adds: Spread = NOTHING_ADDED, wanted: Any = None, **known: Any) -> DirectionFit:
    delay_ns = np.asarray(delay_ns, dtype=np.int64)
    trace = Trace("t", np.arange(len(delay_ns), dtype=np.int64) * 10 * MS, delay_ns)
    fit = fit_direction(DirectionRecord(trace, adds, **known), wanted)
    TypeAdapter(Pipeline).validate_python(fit.stages)
    return fit


def noisy(n: int = 4000) -> np.ndarray:
    """A constant 10 ms with a machine's exponential noise, half of it correlated from message to message."""
    rng = np.random.default_rng(1)
    steps = rng.exponential(30 * US, n + 3)
    return np.rint(10 * MS + steps[:n] + steps[1 : n + 1] + steps[2 : n + 2]).astype(np.int64)


@pytest.mark.parametrize("delay_ns", [[5 * MS] * 300, [0] * 300, [5 * MS, 5 * MS + 900] * 150])
def test_no_spread_is_a_constant(delay_ns: list[int]) -> None:
    fit = fitted(delay_ns)
    assert fit.stages == {
        "delay": {"kind": "constant", "delay_ms": pytest.approx(np.median(delay_ns) / MS, rel=1e-5)}
    }
    assert fit.half_life.why == "the delay is constant"


def test_noise_of_measuring_is_neither_a_distribution_nor_a_correlation() -> None:
    delay_ns = noisy()
    assert fitted(delay_ns).stages["delay"]["kind"] != "constant"
    fit = fitted(delay_ns, Spread(300 * US, 500 * US, np.inf))
    assert set(fit.stages) == {"delay"}
    assert fit.stages["delay"]["kind"] == "constant"
    assert fit.stages["delay"]["delay_ms"] == pytest.approx(np.median(delay_ns) / MS, rel=1e-5)
    assert fit.steady.startswith("varies by")


def test_a_delay_that_varies_by_more_than_measuring_adds_is_fitted() -> None:
    rng = np.random.default_rng(2)
    delay_ns = np.rint(20 * MS + rng.gamma(9, 4 / 3, 20_000) * MS)
    stage = fitted(delay_ns, Spread(300 * US, 900 * US, np.inf)).stages["delay"]
    assert (stage["kind"], stage["mean_ms"], stage["std_ms"]) == (
        "gamma",
        pytest.approx(12, 0.1),
        pytest.approx(4, 0.1),
    )


def test_rare_large_delays_that_were_decided_are_no_noise() -> None:
    delay_ns = np.full(4000, 10 * MS)
    delay_ns[::400] = 40 * MS
    assert fitted(delay_ns).stages["delay"]["kind"] != "constant"


def test_a_distribution_that_is_wanted_is_taken_however_steady_the_delay() -> None:
    fit = fitted(noisy(), Spread(MS, MS, np.inf), wanted="gamma")
    assert (fit.stages["delay"]["kind"], fit.steady) == ("gamma", "")


def test_too_few_that_arrived_are_refused() -> None:
    delay_ns = np.full(MIN_RECEIVED + 5, 5 * MS)
    delay_ns[:6] = LOST
    with pytest.raises(ValueError, match=f"at least {MIN_RECEIVED} messages that arrived, has {MIN_RECEIVED - 1}"):
        fitted(delay_ns)
    delay_ns[0] = 5 * MS
    assert fitted(delay_ns).n_lost == 5


def test_what_the_record_knows_of_copies_and_damage_becomes_stages() -> None:
    delay_ns = np.full(1000, 5 * MS)
    delay_ns[:200] = LOST
    stages = fitted(delay_ns, n_copied=8, flips=Flips(40, 3)).stages
    assert stages["duplicate"] == {"p_duplicate": 0.01}
    assert stages["corrupt"] == {"p_corrupt": 0.05, "bits": 3}
    assert not {"duplicate", "corrupt"} & set(fitted(delay_ns, n_copied=0, flips=Flips(0, 0)).stages)


@pytest.mark.parametrize(
    ("known", "ordering"),
    [
        ({}, "reorder"),
        ({"overtaken": 0.0}, None),
        ({"overtaken": 0.2}, "reorder"),
        ({"n_dropped_late": 3}, "drop_late"),
    ],
)
def test_how_messages_left_is_known_better_than_their_delays_tell(
    known: dict[str, Any], ordering: str | None
) -> None:
    """Each second message takes 30 ms more, so it would be overtaken by the next, 10 ms behind it."""
    assert fitted([5 * MS, 35 * MS] * 100, **known).stages.get("ordering") == ordering
