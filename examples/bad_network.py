"""A Zenoh publisher and a Zenoh subscriber, neither of which knows of `tis`, with an emulated network between them.

Start `tis netem` first (docs/tutorials/bad_network.md), then, each in a terminal of its own:

    python examples/bad_network.py subscribe
    python examples/bad_network.py publish
"""

import argparse
import struct
import time

import zenoh

WEST, EAST = "tcp/127.0.0.1:7447", "tcp/127.0.0.1:7448"
KEY = "demo/position"
WAIT_S = 60.0  # for the emulator, and for the first message
STAMP = struct.Struct("<Iq")  # sequence number and moment of sending, ns of this host's clock


def session(endpoint: str) -> zenoh.Session:
    """Open a session as a client of `endpoint`: a client cannot find the other program past the emulator."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["{endpoint}"]')
    config.insert_json5("connect/timeout_ms", str(int(WAIT_S * 1000)))  # the emulator may start later
    return zenoh.open(config)


def publish(endpoint: str, count: int, rate_hz: float) -> None:
    """Publish `count` messages at `rate_hz`."""
    with session(endpoint) as west:
        publisher = west.declare_publisher(KEY)
        while not publisher.matching_status.matching:  # until netem subscribes, nothing is sent
            time.sleep(0.01)
        begin_ns = time.monotonic_ns()
        for number in range(count):
            due_ns = begin_ns + int(number * 1e9 / rate_hz)
            time.sleep(max(due_ns - time.monotonic_ns(), 0) / 1e9)
            publisher.put(STAMP.pack(number, time.monotonic_ns()))
        time.sleep(0.5)  # the last messages leave before the session closes
    print(f"published {count}")


def subscribe(endpoint: str, count: int, silence_s: float) -> None:
    """Receive until message `count` - 1 arrives, or nothing for `silence_s`, and print what arrived and how late."""
    delays_ms: list[float] = []
    arrived: list[int] = []

    def on_sample(sample: zenoh.Sample) -> None:
        number, sent_ns = STAMP.unpack(sample.payload.to_bytes())
        delays_ms.append((time.monotonic_ns() - sent_ns) / 1e6)
        arrived.append(number)

    with session(endpoint) as east, east.declare_subscriber(KEY, on_sample):
        print("subscribed", flush=True)
        seen, quiet_since = 0, time.monotonic()
        while count - 1 not in arrived[-20:] and time.monotonic() - quiet_since < (silence_s if seen else WAIT_S):
            time.sleep(0.05)
            if len(arrived) > seen:
                seen, quiet_since = len(arrived), time.monotonic()
    if not arrived:
        raise SystemExit("nothing arrived")
    delays_ms.sort()
    lost = max(arrived) + 1 - len(set(arrived))
    print(f"received {len(arrived)} messages, {lost} of the first {max(arrived) + 1} did not arrive")
    print(f"delay: median {delays_ms[len(delays_ms) // 2]:.1f} ms, largest {delays_ms[-1]:.1f} ms")


def main() -> None:
    """Read the command line and run one of the two programs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["publish", "subscribe"])
    parser.add_argument("--endpoint", "-e", help=f"default: {WEST} for publish, {EAST} for subscribe")
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--rate-hz", type=float, default=100.0)
    parser.add_argument("--silence-s", type=float, default=3.0, help="subscribe ends after so long without a message")
    given = parser.parse_args()
    if given.what == "publish":
        publish(given.endpoint or WEST, given.count, given.rate_hz)
    else:
        subscribe(given.endpoint or EAST, given.count, given.silence_s)


if __name__ == "__main__":
    main()
