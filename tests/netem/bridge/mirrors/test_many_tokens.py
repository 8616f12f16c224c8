"""Many tokens that come and go at once: each is mirrored and withdrawn, and messages keep crossing."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import pytest
import zenoh

from tests.common.runtime.live_zenoh import a_client, soon
from tests.netem.bridge.live_bridge import Bridged, a_bridge, bridging, delays, n_tokens, two_routers
from tis.common.channels import Network

pytestmark = pytest.mark.live


@contextmanager
def a_joined_bridge(**network: Any) -> Iterator[Bridged]:
    """Bridge two existing routers as their client: Zenoh reports such a session's own tokens to itself."""
    with two_routers() as (_, endpoints), ExitStack() as stack:
        sessions: dict[Network, zenoh.Session] = {
            name: stack.enter_context(a_client(endpoint)) for name, endpoint in endpoints.items()
        }
        yield stack.enter_context(bridging(sessions, endpoints, probes=False, **network))


def crossed(there: Bridged) -> bool:
    """Tell whether a message crosses now."""
    arrived: list[str] = []
    with there.east.declare_subscriber("hello", lambda sample: arrived.append(str(sample.key_expr))):

        def is_here() -> bool:
            there.west.put("hello", b"")
            return bool(arrived)

        return soon(is_here)


@pytest.mark.parametrize(("n_all", "delay_ms"), [(500, 0.0), (500, 50.0), (2000, 5.0)])
def test_a_client_with_hundreds_of_tokens_may_leave(n_all: int, delay_ms: float) -> None:
    with a_joined_bridge(**delays(delay_ms)) as there:
        with a_client(there.endpoints["west"]) as owner:
            held = [owner.liveliness().declare_token(f"group/{i}") for i in range(n_all)]
            assert soon(lambda: n_tokens(there) == len(held))
        assert soon(lambda: n_tokens(there) == 0)
        assert crossed(there)
        assert there.applications.tokens.n_changes == 2 * n_all


def test_hundreds_of_tokens_outlive_an_outage() -> None:
    outage = [{"at_s": 3.0, "for_s": 4.0, "set": {"outage": True}}]
    with a_joined_bridge(timeline=outage, lease_s=0.3) as there:
        held = [there.west.liveliness().declare_token(f"group/{i}") for i in range(500)]
        assert soon(lambda: n_tokens(there) == len(held))
        assert soon(lambda: there.applications.tokens.n_cuts >= 1 and n_tokens(there) == 0)
        assert soon(lambda: n_tokens(there) == len(held))
        assert crossed(there)


def test_fifty_clients_may_come_and_go() -> None:
    with a_bridge(**delays(5.0)) as there:
        for _ in range(5):
            with ExitStack() as stack:
                clients = [stack.enter_context(a_client(there.endpoints["west"])) for _ in range(10)]
                _held = [one.liveliness().declare_token(f"client/{i}") for i, one in enumerate(clients)]
                assert soon(lambda: n_tokens(there) == 10)
            assert soon(lambda: n_tokens(there) == 0)
        assert crossed(there)
