"""The kernel's TCP beside the model: ``python -m tests.netem.stages.loss.bench_recovery HZ P_LOSS RTT_MS [CONTROL]``.

Needs root, ``ip`` and /dev/net/tun. Two network namespaces are joined by a relay that delays packets by half the
round trip each way and loses a share of those from the sender. ``CONTROL`` is the congestion control: cubic, reno, or
another of the kernel, beside which stands the model without one. The sender's buffer is so large that it never waits.
Other load on the machine shows in TCP: the model stands there also with the lateness that TCP has without a loss.
"""

import fcntl
import heapq
import os
import random
import select
import socket
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tis.common.scenario.network import NetworkPart
from tis.netem.expected.simulate import simulate

SECONDS, WARM_UP_S, DRAIN_S = 30, 2.0, 3.0
REPETITIONS, MOST_HZ = 10, 3000
N_BYTES, PORT, BUFFER_BYTES = 256, 7000, 64_000_000
ENDS = {"tisloss0": ("10.77.0.1", "10.77.0.2"), "tisloss1": ("10.77.0.2", "10.77.0.1")}
SO_SNDBUFFORCE, TUNSETIFF, IFF_TUN, IFF_NO_PI = 32, 0x400454CA, 1, 0x1000


def opened(name: str, address: str, peer: str) -> int:
    """Return a TUN device that is the only network of a namespace of its name."""
    fd = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(fd, TUNSETIFF, struct.pack("16sH22x", name.encode(), IFF_TUN | IFF_NO_PI))
    for command in (
        f"netns add {name}",
        f"link set {name} netns {name}",
        f"-n {name} addr add {address} peer {peer} dev {name}",
        f"-n {name} link set {name} up txqueuelen 10000",
    ):
        subprocess.run(["ip", *command.split()], check=True)
    return fd


class Relay(threading.Thread):
    """Carries packets; once ``is_lossy``, those from the first device are lost with ``p_loss``."""

    def __init__(self, fds: list[int], p_loss: float, delay_s: float) -> None:
        super().__init__(daemon=True)
        self.is_lossy = self.is_over = False
        self.n_sent = self.n_lost = 0
        self._fds, self._p_loss, self._delay_s = fds, p_loss, delay_s

    def run(self) -> None:
        held: list[tuple[float, int, int, bytes]] = []
        n = 0
        while not self.is_over:
            wait_s = max(0.0, held[0][0] - time.monotonic()) if held else 0.05
            for fd in select.select(self._fds, [], [], wait_s)[0]:
                for packet in self._read(fd):
                    n += 1
                    other = self._fds[fd == self._fds[0]]
                    heapq.heappush(held, (time.monotonic() + self._delay_s, n, other, packet))
            while held and held[0][0] <= time.monotonic():
                _, _, fd, packet = heapq.heappop(held)
                os.write(fd, packet)

    def _read(self, fd: int) -> list[bytes]:
        found = []
        try:
            while packet := os.read(fd, 65536):
                if packet[0] >> 4 == 4 and not (fd == self._fds[0] and self._loses()):
                    found.append(packet)
        except BlockingIOError:
            pass
        return found

    def _loses(self) -> bool:
        lost = self.is_lossy and random.random() < self._p_loss
        self.n_sent, self.n_lost = self.n_sent + self.is_lossy, self.n_lost + lost
        return lost


def send(hz: float, n_connections: int, control: str) -> None:
    """Send a message at ``hz`` on each connection."""
    ways = []
    for _ in range(n_connections):
        way = socket.socket()
        way.setsockopt(socket.IPPROTO_TCP, socket.TCP_CONGESTION, control.encode())
        way.setsockopt(socket.SOL_SOCKET, SO_SNDBUFFORCE, BUFFER_BYTES)
        way.connect((ENDS["tisloss0"][1], PORT))
        way.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        ways.append(way)
    start_s = time.monotonic() + 0.5
    due = [(start_s + i / n_connections / hz, i) for i in range(n_connections)]
    while due[0][0] < start_s + SECONDS:
        at_s, i = heapq.heappop(due)
        time.sleep(max(0.0, at_s - time.monotonic()))
        ways[i].sendall(struct.pack("<qi", time.monotonic_ns(), i).ljust(N_BYTES, b"."))
        heapq.heappush(due, (at_s + 1 / hz, i))
    time.sleep(DRAIN_S)


def receive(n_connections: int, path: str) -> None:
    """Write the instants of sending and receiving of all messages to a file."""
    server = socket.create_server((ENDS["tisloss0"][1], PORT), backlog=n_connections)
    print("ready", flush=True)  # noqa: T201
    ways = {(way := server.accept()[0]).fileno(): way for _ in range(n_connections)}
    parts = dict.fromkeys(ways, b"")
    found = []
    while ways:
        for fd in select.select(list(ways), [], [])[0]:
            data = ways[fd].recv(1 << 20)
            now_ns = time.monotonic_ns()
            if not data:
                del ways[fd]
                continue
            data = parts[fd] + data
            n_whole = len(data) // N_BYTES * N_BYTES
            found += [(*struct.unpack_from("<qi", data, at), now_ns) for at in range(0, n_whole, N_BYTES)]
            parts[fd] = data[n_whole:]
    np.save(path, np.array(found, dtype=np.int64))


def measured(hz: float, p_loss: float, rtt_ms: float, control: str) -> tuple[list[NDArray[np.float64]], float]:
    """Return the delays of TCP in ms, by repetition, and the share that was lost."""
    each = connections(hz)
    at_once = max(1, min(REPETITIONS, round(MOST_HZ / hz / each)))
    found: list[NDArray[np.float64]] = []
    shares = []
    while len(found) < REPETITIONS:
        sent_ns, number, got_ns, share = _run(hz, p_loss, rtt_ms / 2000, control, at_once * each)
        kept = sent_ns > sent_ns.min() + 2 * WARM_UP_S * 1e9
        delays_ms = (got_ns - sent_ns) / 1e6
        found += [delays_ms[kept & (number // each == n)] for n in range(at_once)]
        shares.append(share)
    return found, float(np.mean(shares))


def connections(hz: float) -> int:
    """Return the connections of a repetition, so many that together they carry at least 100 messages/s."""
    return max(1, round(100 / hz))


def _run(hz: float, p_loss: float, delay_s: float, control: str, n: int) -> tuple[Any, Any, Any, float]:
    fds = [opened(name, *addresses) for name, addresses in ENDS.items()]
    relay = Relay(fds, p_loss, delay_s)
    relay.start()
    me = [sys.executable, "-m", "tests.netem.stages.loss.bench_recovery"]
    try:
        with TemporaryDirectory() as folder:
            path = str(Path(folder) / "instants.npy")
            east = ["ip", "netns", "exec", "tisloss1", *me, "receive", str(n), path]
            west = ["ip", "netns", "exec", "tisloss0", *me, "send", str(hz), str(n), control]
            with subprocess.Popen(east, stdout=subprocess.PIPE) as receiver:
                assert receiver.stdout is not None
                receiver.stdout.readline()
                with subprocess.Popen(west):
                    time.sleep(WARM_UP_S)
                    relay.is_lossy = True
            sent_ns, number, got_ns = np.load(path).T
    finally:
        relay.is_over = True
        relay.join()
        for name, fd in zip(ENDS, fds, strict=True):
            os.close(fd)
            subprocess.run(["ip", "netns", "del", name], check=True)
    return sent_ns, number, got_ns, relay.n_lost / relay.n_sent


def modelled(hz: float, p_loss: float, rtt_ms: float, control: str) -> list[NDArray[np.float64]]:
    """Return the delays of the model in ms, by repetition."""
    each, known = connections(hz), control in ("cubic", "reno")
    recovery = {"congestion": control if known else "none"}
    loss = {"kind": "bernoulli", "p_loss": p_loss, "recovery": recovery}
    stages = {"delay": {"kind": "constant", "delay_ms": rtt_ms / 2}, "loss": loss}
    network = NetworkPart.model_validate({"forward": stages})
    offered_ns = (np.arange((SECONDS - WARM_UP_S) * hz) * (1e9 / hz)).astype(np.int64)
    kept = offered_ns >= WARM_UP_S * 1e9
    seeds = iter(range(REPETITIONS * each))
    found = []
    for _ in range(REPETITIONS):
        own = [simulate(network, "forward", next(seeds), offered_ns, N_BYTES).delay_ns[kept] for _ in range(each)]
        found.append(np.concatenate(own) / 1e6)
    return found


def main(hz: float, p_loss: float, rtt_ms: float, control: str = "cubic") -> None:
    """Print quantiles of both: the median of the repetitions, the least and the largest."""
    tcp_ms, share = measured(hz, p_loss, rtt_ms, control)
    sent_ns, _, got_ns, _ = _run(hz, 0.0, rtt_ms / 2000, control, max(1, round(MOST_HZ / 10 / hz)))
    late_ms = (got_ns - sent_ns) / 1e6 - rtt_ms / 2
    model_ms = modelled(hz, share, rtt_ms, control)
    rng = np.random.default_rng(1)
    late_model_ms = [one + rng.choice(late_ms, len(one)) for one in model_ms]
    print(f"{control}, {hz:g}/s, round trip {rtt_ms:g} ms, lost {share:.2%}; p50, p90, p99 in ms")  # noqa: T201
    for name, delays_ms in (("TCP", tcp_ms), ("model", model_ms), ("model, machine late", late_model_ms)):
        columns = np.array([np.quantile(one, [0.5, 0.9, 0.99]) for one in delays_ms]).T
        words = [f"{np.median(of):.1f} ({of.min():.1f} to {of.max():.1f})" for of in columns]
        print(f"{name:19} {', '.join(words)}")  # noqa: T201


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["send", hz, n, control]:
            send(float(hz), int(n), control)
        case ["receive", n, path]:
            receive(int(n), path)
        case [hz, p_loss, rtt_ms, *control]:
            main(float(hz), float(p_loss), float(rtt_ms), *control)
