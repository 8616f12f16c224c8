"""Advanced publishers and subscribers through a real bridge: what crosses, and what a lost question holds up."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import zenoh
from zenoh.ext import (
    CacheConfig,
    HistoryConfig,
    MissDetectionConfig,
    RecoveryConfig,
    declare_advanced_publisher,
    declare_advanced_subscriber,
)

from tests.common.runtime.live_zenoh import settle, soon
from tests.netem.bridge.live_bridge import Bridged, a_bridge, n_open
from tis.common.runtime.zenoh_session import ZenohOptions, configure

pytestmark = pytest.mark.live

KEY = "demo/x"
N_BEFORE, N = 3, 30
_beating: Any = MissDetectionConfig  # of which the binding's own types want every argument
_recovering: Any = RecoveryConfig
LOST: dict[str, Any] = {"loss": {"kind": "bernoulli", "p_loss": 1}}


@contextmanager
def _late_subscriber(bridged: Bridged, detects: bool) -> Iterator[list[int]]:
    """Publish some numbers, let a subscriber come, and publish more; give what the subscriber gets.

    ``detects``: with miss detection, and what is missed is asked for.
    """
    got: list[int] = []
    misses: dict[str, Any] = {"sample_miss_detection": _beating(heartbeat=0.2)} if detects else {}
    recovery: dict[str, Any] = {"recovery": _recovering(heartbeat=True)} if detects else {}
    stamping = ZenohOptions(connect=[bridged.endpoints["west"]], cfg=("timestamping/enabled:true",))
    with (
        zenoh.open(configure("client", stamping)) as west,
        declare_advanced_publisher(west, KEY, cache=CacheConfig(max_samples=4 * N), **misses) as publisher,
    ):
        for i in range(N_BEFORE):
            publisher.put(str(i))
        assert soon(lambda: bridged.bridge.links["forward"].released >= N_BEFORE)
        settle(west, bridged.east)
        with declare_advanced_subscriber(
            bridged.east, KEY, lambda sample: got.append(int(sample.payload.to_string())),
            history=HistoryConfig(), **recovery,
        ):  # fmt: skip
            queries = bridged.applications.queries
            assert soon(lambda: queries.n_asked > 0 and n_open(bridged) == 0)
            sent: list[int] = []

            def flows() -> bool:
                if len(sent) < 2 * N:
                    publisher.put(str(N_BEFORE + len(sent)))
                    sent.append(1)
                return len(set(got)) >= N

            assert soon(flows), got
            yield got


def test_without_miss_detection_what_was_said_before_comes_once_and_in_order() -> None:
    with a_bridge(keys=("demo/**",)) as bridged, _late_subscriber(bridged, detects=False) as got:
        assert got[:N] == list(range(N))
        assert not bridged.applications.queries.has_lost_a_source
    assert bridged.leaks == []  # nothing to warn of


def test_numbers_of_miss_detection_that_a_reply_cannot_carry_are_warned_of() -> None:
    with a_bridge(keys=("demo/**",)) as bridged, _late_subscriber(bridged, detects=True) as got:
        assert set(got) >= set(range(N))
        assert soon(lambda: len(bridged.leaks) == 1)
        assert "a cache numbers its replies for miss detection" in bridged.leaks[0]


@pytest.mark.parametrize(
    ("way", "n_of_the_cache"),
    [("forward", N_BEFORE), ("feedback", 0)],  # the end of the replies is lost; the question is
)
def test_a_question_or_an_end_that_is_lost_holds_nothing_back(way: str, n_of_the_cache: int) -> None:
    rule = {"key": "demo/**/@adv/**", "direction": way, "pipeline": LOST}
    with (
        a_bridge(keys=("demo/**",), time_out_s=600.0, rules=[rule]) as bridged,
        _late_subscriber(bridged, detects=True) as got,
    ):
        # had it been left open, nothing would have come before the subscriber's own time-out
        assert bridged.applications.queries.n_timed_out == 0
        assert len({i for i in got if i < N_BEFORE}) == n_of_the_cache
