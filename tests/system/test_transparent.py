"""`tis netem` as a process between two networks: what applications put in on one side comes out on the other."""

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
import zenoh
from zenoh import ext

from tests.common.runtime.live_zenoh import a_client, a_router, settle, soon
from tests.log_reader import LogReader
from tis.common.channels import Network
from tis.common.runtime.ports import free_endpoints

pytestmark = pytest.mark.live

_ROOT = Path(__file__).resolve().parents[2]
_PATIENCE_S = 30
Samples = list[zenoh.Sample]
Start = Callable[..., "Netem"]


class Netem:
    """A `tis netem` under way."""

    def __init__(self, *words: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tis.deploy.cli.main", "netem", *words],
            cwd=_ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            env={**os.environ, "COLUMNS": "200"},
        )  # fmt: skip
        self.said: list[str] = []

    def await_running(self) -> None:
        """Read what it says until it runs."""
        assert self.process.stderr is not None
        watchdog = threading.Timer(_PATIENCE_S, self.process.kill)
        watchdog.start()
        try:
            for line in self.process.stderr:
                self.said.append(line.strip())
                if "netem: running" in line:
                    return
        finally:
            watchdog.cancel()
        raise AssertionError(self.said)

    def end(self) -> tuple[int, str]:
        """Interrupt it; return its exit code and what it printed."""
        self.process.send_signal(signal.SIGINT)
        out, err = self.process.communicate(timeout=120)
        return self.process.returncode, out + err


@pytest.fixture
def start() -> Iterator[Start]:
    """Return a function that starts `tis netem`; whatever still runs at the end is killed."""
    started: list[Netem] = []

    def start_netem(*words: str, runs: bool = True) -> Netem:
        started.append(Netem(*words))
        if runs:
            started[-1].await_running()
        return started[-1]

    yield start_netem
    for netem in started:
        if netem.process.poll() is None:
            netem.process.kill()
        netem.process.communicate()


@pytest.fixture
def places() -> dict[Network, str]:
    west, east = free_endpoints()
    return {"west": west, "east": east}


def _delay(delay_ms: float) -> list[str]:
    stage = f"{{kind: constant, delay_ms: {delay_ms}}}"
    return ["--set", f"forward.delay={stage}", "--set", f"feedback.delay={stage}"]


def _put_everything(session: zenoh.Session) -> None:
    """Publish in all the ways that a receiver can tell apart."""
    session.put("demo/plain", b"x")
    session.put("demo/empty", b"")
    session.put("demo/with space/ä", "text", encoding="text/plain;lang")
    session.put("demo/large", bytes(range(256)) * 1000)
    session.put("0/chatter/std_msgs::msg::dds_::String_/RIHS01_x", b"cdr", attachment=bytes(range(33)))
    session.put("demo/stamped", b"t", timestamp=zenoh.Timestamp(zenoh.NTP64(1_700_000_000, 5), b"abc"))
    session.delete("demo/gone", attachment=b"because")
    for priority in (zenoh.Priority.REAL_TIME, zenoh.Priority.BACKGROUND):
        for congestion in (zenoh.CongestionControl.DROP, zenoh.CongestionControl.BLOCK):
            session.put("demo/quality", b"q", priority=priority, congestion_control=congestion, express=True)
    source = zenoh.SourceInfo(session.id, 41)
    session.put("demo/sourced", b"s", source_info=source)


def _readable(sample: zenoh.Sample) -> tuple[object, ...]:
    attachment = None if sample.attachment is None else sample.attachment.to_bytes()
    key, stamp = str(sample.key_expr), sample.timestamp
    # a router stamps what is put without a timestamp; a delete only gets one where it enters through a session
    stamped = stamp is not None or sample.kind == zenoh.SampleKind.DELETE
    return (
        key, sample.payload.to_bytes(), str(sample.encoding), sample.kind, attachment, sample.priority,
        sample.express, sample.congestion_control, str(stamp) if key == "demo/stamped" else stamped,
        None if sample.source_info is None else sample.source_info.source_sn,
    )  # fmt: skip


def _heard(publish: zenoh.Session, listen: zenoh.Session, n: int) -> list[tuple[object, ...]]:
    samples: Samples = []
    with listen.declare_subscriber("**", samples.append):
        settle(listen)
        _put_everything(publish)
        assert soon(lambda: len(samples) >= n), [str(sample.key_expr) for sample in samples]
        time.sleep(0.1)
    return sorted((_readable(sample) for sample in samples), key=repr)


def test_everything_of_a_message_that_can_be_read_is_as_it_was_in_either_direction(
    start: Start, places: dict[Network, str]
) -> None:
    with a_router(places["west"]), a_client(places["west"]) as publisher, a_client(places["west"]) as subscriber:
        expected = _heard(publisher, subscriber, 12)
    assert len(expected) == 12
    netem = start("--west", places["west"], "--east", places["east"])
    directions: list[tuple[Network, Network]] = [("west", "east"), ("east", "west")]
    for origin, other in directions:
        with a_client(places[origin]) as publisher, a_client(places[other]) as subscriber:
            assert _heard(publisher, subscriber, 12) == expected, origin
    code, text = netem.end()
    assert code == 0
    assert "unsent" not in text


def test_a_round_trip_takes_the_delay_twice_and_the_end_says_what_was_done(
    start: Start, places: dict[Network, str], tmp_path: Path
) -> None:
    netem = start(
        "--west",
        places["west"],
        "--east",
        places["east"],
        *_delay(30.0),
        "--run-dir",
        str(tmp_path / "run"),
        "test/**",
    )
    assert "netem: forward (west to east): delay 30 ms, sd 0" in netem.said
    with a_client(places["west"]) as west, a_client(places["east"]) as east:
        pong = east.declare_publisher("test/pong", express=True)
        east.declare_subscriber("test/ping", lambda sample: pong.put(sample.payload))
        back = west.declare_subscriber("test/pong")
        ping = west.declare_publisher("test/ping", express=True)
        settle(west, east)
        took_s = []
        for _ in range(10):
            began_s = time.monotonic()
            ping.put(b"8 bytes!")
            assert back.recv().payload.to_bytes() == b"8 bytes!"
            took_s.append(time.monotonic() - began_s)
        west.put("demo/outside", b"does not cross")
    assert 0.06 <= min(took_s) < 0.1
    code, text = netem.end()
    assert code == 0
    assert re.search(r"offered +released +held +copies ", text)  # nothing was dropped
    assert re.search(r"forward \(west to east\) +10 +10 +0 +0 ", text)
    assert re.search(r"feedback \(east to west\) +10 +10 +0 +0 ", text)
    log = LogReader(tmp_path / "run" / "netem.mcap")
    assert sum(1 for topic, _ in log.messages() if topic == "/tis/releases") >= 2
    assert log.damage is None


def test_applications_that_find_each_other_by_multicast_make_the_run_invalid(
    start: Start, places: dict[Network, str]
) -> None:
    address = 'scouting/multicast/address:"224.0.0.224:27447"'  # of this test alone
    netem = start("--west", places["west"], "--east", places["east"], "--cfg", address, "demo/**", "0/**")
    assert "netem: crossing: demo/**, 0/** and @ros2_lv/0/**" in netem.said
    with ExitStack() as stack:
        for endpoint in places.values():
            config = zenoh.Config()  # Zenoh's defaults: a peer that scouts
            config.insert_json5("connect/endpoints", json.dumps([endpoint]))
            key, _, value = address.partition(":")
            config.insert_json5(key, value)
            stack.enter_context(zenoh.open(config))
        assert netem.process.stderr is not None
        watchdog = threading.Timer(_PATIENCE_S, netem.process.kill)
        watchdog.start()
        # that they are connected to each other is told, too: by their gossip, which may be heard first
        by_multicast = "applications of both networks find each other past netem by multicast"
        heard = []
        for line in iter(netem.process.stderr.readline, ""):
            heard.append(line)
            if by_multicast in line:
                break
        assert by_multicast in heard[-1]
        assert sum(line.startswith("netem: warning (bypass): ") for line in heard) == 1
        watchdog.cancel()
    code, text = netem.end()
    assert code == 5
    assert re.search(r"\b1 way past netem found: not valid", text)


def test_ros_2_sees_its_graph_and_finds_its_services(start: Start, places: dict[Network, str]) -> None:
    """The keys and the query target of rmw_zenoh."""
    start("--west", places["west"], "--east", places["east"], "0/**")
    service, token = "0/add/example::AddTwoInts_/RIHS01_y", "@ros2_lv/0/abc/0/11/SS/%/%/node/%add/type/hash/qos"

    def serve(query: zenoh.Query) -> None:
        with query:
            query.reply(service, b"3", attachment=bytes(33))

    def call(session: zenoh.Session) -> list[bytes]:
        replies = session.get(
            service, payload=b"12", attachment=bytes(33), timeout=2.0,
            target=zenoh.QueryTarget.ALL_COMPLETE, consolidation=zenoh.ConsolidationMode.NONE,
        )  # fmt: skip
        return [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]

    def graph(session: zenoh.Session) -> list[str]:
        replies = session.liveliness().get("@ros2_lv/0/**", timeout=2.0)
        return [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]

    with a_client(places["west"]) as west, a_client(places["east"]) as east:
        queryable = east.declare_queryable(service, serve, complete=True)
        with east.liveliness().declare_token(token):
            assert soon(lambda: graph(west) == [token])
            assert soon(lambda: call(west) == [b"3"])
        assert soon(lambda: graph(west) == [])
        queryable.undeclare()  # type: ignore[no-untyped-call]


def test_a_late_advanced_subscriber_gets_the_cache_once_and_recovers_an_outage(
    start: Start, places: dict[Network, str]
) -> None:
    outage = "timeline=[{at_s: 2.2, for_s: 0.2, direction: forward, set: {outage: true}}]"
    netem = start("--west", places["west"], "--east", places["east"], "--set", outage, "demo/**")
    began_s = time.monotonic()
    heard: list[str] = []
    with a_client(places["west"]) as west, a_client(places["east"]) as east:
        publisher = ext.declare_advanced_publisher(
            west, "demo/state", cache=ext.CacheConfig(max_samples=100), publisher_detection=True,
            sample_miss_detection=ext.MissDetectionConfig(heartbeat=0.1, sporadic_heartbeat=None),
        )  # fmt: skip
        for i in range(3):
            publisher.put(str(i))
        time.sleep(0.3)
        subscriber = ext.declare_advanced_subscriber(
            east, "demo/**", lambda sample: heard.append(sample.payload.to_string()),
            history=ext.HistoryConfig(detect_late_publishers=True), subscriber_detection=True,
            recovery=ext.RecoveryConfig(heartbeat=True, periodic_queries=None),
        )  # fmt: skip
        assert soon(lambda: len(heard) >= 3)
        time.sleep(0.3)
        assert heard == ["0", "1", "2"]
        for i in range(3, 30):
            time.sleep(max(0.0, began_s + 1.5 + 0.05 * (i - 3) - time.monotonic()))
            publisher.put(str(i))
        assert soon(lambda: sorted(set(heard), key=int) == [str(i) for i in range(30)]), heard
        # without source information, which replies cannot have here, one that is under way may come twice
        assert max(Counter(heard).values()) <= 2
        subscriber.undeclare()  # type: ignore[no-untyped-call]
        publisher.undeclare()  # type: ignore[no-untyped-call]
    said = netem.end()[1]
    assert re.search(r"offered +released +outage +held", said)
    assert re.search(r"forward \(west to east\) +\d+ +\d+ +[1-9]\d* ", said)


def test_control_keys_stay_where_they_are(start: Start, places: dict[Network, str]) -> None:
    start("--west", places["west"], "--east", places["east"])
    samples: Samples = []
    with a_client(places["west"]) as west, a_client(places["east"]) as east:
        for key in ("**", "**/@tis/**", "@tis/**"):
            east.declare_subscriber(key, samples.append)
        settle(east)
        for key in ("tis/netem/control/junk", "s/@tis/epoch", "@tis/netem/past/0/0", "demo/last"):
            west.put(key, b"{}")
        assert soon(lambda: any(str(sample.key_expr) == "demo/last" for sample in samples))
        own = ("@tis/netem/", "tis/netem/control/acknowledged")
        assert {k for k in (str(s.key_expr) for s in samples) if not k.startswith(own)} == {"demo/last"}


def test_it_also_bridges_when_it_connects_to_routers_that_are_there(start: Start, places: dict[Network, str]) -> None:
    asked: list[str] = []

    def answer(query: zenoh.Query) -> None:
        with query:
            asked.append(str(query.selector))
            query.reply("demo/a", b"yes")

    with a_router(places["west"]), a_router(places["east"]):
        netem = start("--connect-west", places["west"], "--connect-east", places["east"], *_delay(20.0), "demo/**")
        heard: Samples = []
        with a_client(places["west"]) as west, a_client(places["east"]) as east:
            east.declare_subscriber("demo/**", heard.append)
            east.declare_queryable("demo/**", answer)
            settle(east)
            west.put("demo/x", b"1")
            assert soon(lambda: len(heard) == 1)
            took_s, found = 0.0, [b""]

            def get() -> bool:
                nonlocal took_s, found
                began_s = time.monotonic()
                found = [r.ok.payload.to_bytes() for r in west.get("demo/a", timeout=2.0) if r.ok]
                took_s = time.monotonic() - began_s
                return found == [b"yes"]

            assert soon(get), found
            assert took_s >= 0.04
            with west.liveliness().declare_token("demo/token"):
                assert soon(lambda: len(list(east.liveliness().get("demo/**"))) == 1)
        assert netem.end()[0] == 0


def test_one_side_listens_and_the_other_connects_as_a_peer(start: Start, places: dict[Network, str]) -> None:
    config = zenoh.Config()
    config.insert_json5("listen/endpoints", f'["{places["east"]}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    heard: Samples = []
    with zenoh.open(config) as peer:
        peer.declare_subscriber("demo/**", heard.append)
        netem = start(
            "--west", places["west"], "--connect-east", places["east"], "--mode", "peer", "--insecure", "demo/**"
        )
        with a_client(places["west"]) as west:
            assert soon(lambda: bool(west.put("demo/x", b"1") or heard))
        assert netem.end()[0] == 0


def test_it_refuses_to_make_a_ring_or_to_be_got_round(start: Start, places: dict[Network, str]) -> None:
    start("--west", places["west"], "--east", places["east"], "demo/**")
    connect = ["--connect-west", places["west"], "--connect-east", places["east"], "demo/**"]
    ring = start(*connect, runs=False)
    _, err = ring.process.communicate(timeout=120)
    assert ring.process.returncode == 3
    assert "another netem joins the two networks" in err
    third, _ = free_endpoints()
    with a_router(third, places["west"], places["east"]):
        around = start(*connect, runs=False)
        _, err = around.process.communicate(timeout=120)
    assert around.process.returncode == 3
    assert "reach the other network past netem" in err
    same = start("--connect-west", places["west"], "--connect-east", f"{places['west']}?x=1", runs=False)
    _, err = same.process.communicate(timeout=120)
    assert same.process.returncode == 2
    assert "must not be an endpoint of the other side" in err
