"""Lines of Zenoh's log as it writes them: which peers have a link to which, and so past netem."""

from typing import Final

from tis.netem.bridge.gossip import Gossip

ROUTER, WEST, EAST = "8ffbe51805775894921a45cfa76f8ddc", "4f01278033ee50af6bec3e6d908e8834", "b8f445a9a185cba1fb231e9"
_HEAD: Final = (
    "\x1b[2m2026-11-28T14:30:13.458527Z\x1b[0m \x1b[35mTRACE\x1b[0m  rx-1 ThreadId(09) "
    "\x1b[2mzenoh::net::protocol::network\x1b[0m\x1b[2m:\x1b[0m [Gossip] Received from "
)


def _line(sender: str, told_of: str, *links: str) -> bytes:
    linked = ", ".join(f"{zid}: None" for zid in links)
    return (
        f"{_HEAD}{sender} mapped: LocalLinkState {{ sn: 3, zid: {told_of}, whatami: Peer, "
        f"locators: Some([tcp/127.0.0.1:51131]), links: {{{linked}}}, is_gateway: false }}\n"
    ).encode()


def link_state(peer: str, *links: str) -> bytes:
    """Return the line of the log for what a peer tells of its own links."""
    return _line(peer, peer, *links)


def _between(gossip: Gossip) -> list[tuple[str, str]]:
    return gossip.between({WEST, "a"}, {EAST, "b"})


def test_a_link_between_members_of_both_networks_is_found_and_its_end_too() -> None:
    gossip = Gossip()
    gossip.take(_line(WEST, WEST, ROUTER))
    assert _between(gossip) == []
    gossip.take(_line(WEST, WEST, ROUTER, EAST))
    assert _between(gossip) == [(WEST, EAST)]
    assert gossip.n_news == 2
    gossip.take(_line(WEST, WEST, ROUTER))
    assert _between(gossip) == []


def test_one_end_that_tells_it_suffices() -> None:
    gossip = Gossip()
    gossip.take(_line(EAST, EAST, ROUTER, WEST))
    assert _between(gossip) == [(WEST, EAST)]


def test_what_a_peer_tells_of_others_and_what_is_no_such_line_counts_for_nothing() -> None:
    gossip = Gossip()
    gossip.take(_line(WEST, EAST, WEST))
    for line in (
        b"",
        b"\xff mapped: LocalLinkState {",
        _line(WEST, WEST, EAST).replace(b"mapped", b"raw"),
        b"x" * 100_000,
    ):
        gossip.take(line)
    assert gossip.n_news == 0
    assert _between(gossip) == []


def test_a_link_to_what_is_no_member_is_told_by_the_member_alone() -> None:
    gossip = Gossip()
    gossip.take(_line(WEST, WEST, ROUTER, EAST))
    assert gossip.beyond({WEST}, {WEST, ROUTER}) == {(WEST, EAST)}
    assert gossip.beyond({WEST}, {WEST, ROUTER, EAST}) == set()
    assert gossip.beyond({EAST}, {ROUTER}) == set()
