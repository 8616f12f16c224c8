"""Up to when an observer may call a packet lost."""

from typing import Final

from tis.common.channels import Network
from tis.common.units import NS_PER_S
from tis.deploy.watch.observer import heard_until_ns

BOTH: Final[tuple[Network, ...]] = ("west", "east")


def test_a_packet_is_not_lost_before_the_later_network_was_heard() -> None:
    """East is heard 2 s late, as by a thread that got no processor: what came there meanwhile is not known yet."""
    now_ns = 100 * NS_PER_S
    assert heard_until_ns(now_ns, {"west": now_ns - 1, "east": 98 * NS_PER_S}, BOTH) == 98 * NS_PER_S


def test_a_network_that_is_silent_for_long_holds_nothing_up() -> None:
    now_ns = 100 * NS_PER_S
    assert heard_until_ns(now_ns, {"west": now_ns - 1}, BOTH) == 97 * NS_PER_S
    assert heard_until_ns(now_ns, {}, BOTH) == 97 * NS_PER_S


def test_it_never_lies_ahead() -> None:
    assert heard_until_ns(5, {"west": 9, "east": 8}, BOTH) == 5
