"""Connections that are cut by their other end, or because they keep a session from closing, over loopback."""

import socket
import time
from collections.abc import Callable
from typing import cast

import pytest
import zenoh

from tis.common.errors import Fault, PeerError
from tis.common.runtime import connections
from tis.common.runtime.connections import closing, cut
from tis.common.runtime.ports import free_endpoints
from tis.common.runtime.zenoh_session import ZenohOptions, configure, visitor


@pytest.mark.parametrize(("family", "host"), [(socket.AF_INET, "127.0.0.1"), (socket.AF_INET6, "::1")])
def test_one_connection_is_cut_by_its_other_end_and_the_others_stay(family: socket.AddressFamily, host: str) -> None:
    with socket.create_server((host, 0), family=family) as server:
        place = server.getsockname()[:2]
        with socket.create_connection(place) as one, socket.create_connection(place) as other:
            accepted = [server.accept()[0] for _ in range(2)]
            name, port = one.getsockname()[:2]
            end = f"[{name}]:{port}" if ":" in name else f"{name}:{port}"
            assert cut({end, "192.0.2.1:1"}) == 1
            one.settimeout(10)
            assert one.recv(1) == b""
            other.sendall(b"x")
            assert next(c for c in accepted if c.getpeername()[1] == other.getsockname()[1]).recv(1) == b"x"
            for each in accepted:
                each.close()
    assert cut({end}) == 0


@pytest.mark.live
def test_a_session_that_connects_again_to_what_does_not_answer_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    endpoint = free_endpoints()[0]
    config = visitor(endpoint, ZenohOptions())
    n_cut: list[int] = []
    shut = connections._cut

    def dawdling(is_meant: Callable[[tuple[object, ...]], bool]) -> None:
        n = shut(is_meant)
        time.sleep(0.2)  # the session is closed meanwhile: a cut that went on would meet the next one's connections
        n_cut.append(n)

    monkeypatch.setattr(connections, "_cut", dawdling)
    with zenoh.open(configure("router", ZenohOptions(listen=[endpoint]))) as router:
        session = zenoh.open(config)
        with closing(session, config):
            router.close()  # type: ignore[no-untyped-call]
            with socket.create_server(("127.0.0.1", int(endpoint.rpartition(":")[2]))) as silent:
                attempt, _ = silent.accept()
        with attempt:
            assert n_cut == [1]
            assert session.is_closed()


def test_an_error_of_closing_is_not_the_users_and_hides_none_of_the_block() -> None:
    class Session:
        def close(self) -> None:
            raise zenoh.ZError("close operation timed out!")

    config = visitor("tcp/127.0.0.1:1", ZenohOptions())
    with closing(cast("zenoh.Session", Session()), config):
        pass
    with pytest.raises(PeerError), closing(cast("zenoh.Session", Session()), config):
        raise PeerError(Fault("netem", "", "is gone"))
