"""Programs that do not speak Zenoh, across carried bytes; skipped where their libraries are not there."""

import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from tests.netem.bridge.live_bridge import carrying

pytestmark = pytest.mark.live

BURST = {"kind": "burst", "p_loss": 0.03, "mean_burst": 3, "recovery": {"rto_ms": 30}}
NETWORK: dict[str, Any] = {
    "forward": {"delay": {"kind": "constant", "delay_ms": 2}, "loss": BURST},
    "feedback": {"delay": {"kind": "constant", "delay_ms": 2}},
}
N = 150


def test_grpc_calls_and_streams_cross() -> None:
    grpc = pytest.importorskip("grpc", reason="needs grpcio")

    class Echo(grpc.GenericRpcHandler):  # type: ignore[misc, name-defined, unused-ignore]
        def service(self, details: Any) -> Any:
            if details.method == "/echo/one":
                return grpc.unary_unary_rpc_method_handler(lambda request, _: request)
            return grpc.stream_stream_rpc_method_handler(lambda requests, _: requests)

    server = grpc.server(ThreadPoolExecutor(4))
    server.add_generic_rpc_handlers((Echo(),))
    port = server.add_insecure_port("127.0.0.1:0")
    server.start()
    with carrying(("127.0.0.1", port), 1448, **NETWORK) as (driver, proxy, address):
        with grpc.insecure_channel(f"{address[0]}:{address[1]}") as channel:
            one, many = channel.unary_unary("/echo/one"), channel.stream_stream("/echo/many")
            sent = [bytes([i]) * (1 + 20 * i) for i in range(N)]
            assert [one(message, timeout=30) for message in sent] == sent
            assert list(many(iter(sent), timeout=30)) == sent
        assert proxy.n_connections == 1
        assert not any(sum(link.dropped.values()) for link in driver.links.values())
    server.stop(None).wait()


def test_web_sockets_cross_in_order() -> None:
    client = pytest.importorskip("websockets.sync.client", reason="needs websockets")
    server = pytest.importorskip("websockets.sync.server", reason="needs websockets")

    def echo(connection: Any) -> None:
        for message in connection:
            connection.send(message)

    with server.serve(echo, "127.0.0.1", 0) as serving:
        threading.Thread(target=serving.serve_forever, daemon=True).start()
        with carrying(serving.socket.getsockname(), 1448, **NETWORK) as (_, proxy, (host, port)):
            with client.connect(f"ws://{host}:{port}") as connection:
                sent = [str(i) * (1 + i) for i in range(N)]
                for message in sent:
                    connection.send(message)
                assert [connection.recv(timeout=30) for _ in sent] == sent
            assert proxy.n_connections == 1
        serving.shutdown()
