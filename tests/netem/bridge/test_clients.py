"""The clients of a relay, by literal times."""

from typing import Any

from tis.netem.bridge.clients import IDLE_S, MAX_CLIENTS, Clients


def _clients() -> Clients:
    made: Any = object
    return Clients(made)


def test_an_idle_client_is_forgotten_and_its_place_used_again() -> None:
    clients = _clients()
    first, second = clients.of("a", 0.0), clients.of("b", 1.0)
    assert first is not None
    assert second is not None
    assert clients.of("a", 2.0) is first
    assert clients.silent(1.0 + IDLE_S - 0.1) == []
    assert clients.silent(1.0 + IDLE_S) == [second]
    again = clients.of("c", 400.0)
    assert again is not None
    assert (first.place, second.place, again.place) == (1, 2, 2)
    assert clients.n_seen == 3


def test_beyond_the_bound_a_client_is_refused_until_the_longest_silent_one_gives_way() -> None:
    clients = _clients()
    for number in range(MAX_CLIENTS):
        assert clients.of(number, float(number) / MAX_CLIENTS) is not None
    assert clients.of("one more", 20.0) is None
    assert clients.silent(20.0) == []
    assert [client.address for client in clients.silent(31.5)] == [0]
    assert clients.of("one more", 32.0) is not None
