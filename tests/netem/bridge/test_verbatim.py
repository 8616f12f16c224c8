"""Keys with a verbatim chunk, which begins with ``@``: no wildcard of Zenoh matches them, so they must be named."""

import pytest
import zenoh

from tests.common.runtime.live_zenoh import settle, soon
from tests.netem.bridge.live_bridge import a_bridge, n_tokens
from tis.common.scenario.network import NetworkPart
from tis.netem.bridge.keys import crossing_keys
from tis.netem.bridge.sides import Place
from tis.netem.bridge.standalone import Standalone, _crossing

_PLACES = {"west": Place(listen=("tcp/127.0.0.1:1",)), "east": Place(listen=("tcp/127.0.0.1:2",))}
_HINT = "of keys with a chunk that begins with @ only those named"


@pytest.mark.parametrize(
    ("keys", "unmatched", "hints"),
    [(("**",), "refuse", True), (("demo/**",), "refuse", False), (("demo/**",), "pass", True)],
)
def test_all_keys_are_said_to_be_not_quite_all(keys: tuple[str, ...], unmatched: str, hints: bool) -> None:
    network = NetworkPart.model_validate({"unmatched": unmatched})
    assert (_HINT in _crossing(Standalone(_PLACES, network, keys))) == hints  # type: ignore[arg-type]


def test_named_ones_cross_beside_all_keys() -> None:
    assert crossing_keys(["**", "@x/**", "demo/@y/*"]).messages[::2] == ("**", "@x/**", "demo/@y/*")


@pytest.mark.live
def test_messages_queries_and_tokens_of_named_ones_cross() -> None:
    with a_bridge(keys=["**", "@x/**", "demo/@y/*"]) as there:
        arrived: list[str] = []

        def answer(query: zenoh.Query) -> None:
            with query:
                query.reply("@x/a", b"")

        with (
            there.east.declare_subscriber("@x/a", lambda sample: arrived.append(str(sample.key_expr))),
            there.east.declare_subscriber("demo/@y/b", lambda sample: arrived.append(str(sample.key_expr))),
            there.east.declare_subscriber("@z/c", lambda sample: arrived.append(str(sample.key_expr))),
            there.east.declare_queryable("@x/a", answer, complete=True),
            there.west.liveliness().declare_token("@x/alive"),
        ):
            settle(there.east, there.west)
            for key in ("@z/c", "@x/a", "demo/@y/b"):
                there.west.put(key, b"")
            assert soon(lambda: len(arrived) >= 2)
            assert sorted(arrived) == ["@x/a", "demo/@y/b"]
            assert soon(lambda: n_tokens(there) == 1)
            assert [reply.ok is not None for reply in there.west.get("@x/a", timeout=3.0)] == [True]


def test_no_wildcard_of_zenoh_matches_them() -> None:
    """The reason for all this, from the binding itself."""
    assert not zenoh.KeyExpr("**").intersects(zenoh.KeyExpr("@x/a"))
    assert not zenoh.KeyExpr("demo/*/b").intersects(zenoh.KeyExpr("demo/@y/b"))
