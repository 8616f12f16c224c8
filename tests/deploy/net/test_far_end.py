"""A probe to a far end in a process of its own, whose clock is wrong and whose boot id is another one."""

import json
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import zenoh

from tests.common.runtime.live_zenoh import a_client, a_router
from tests.deploy.commands import call
from tests.netem.bridge.live_bridge import a_bridge, delays
from tis.common.errors import PeerError
from tis.common.runtime.clock import SKEW_VARIABLE
from tis.common.runtime.ports import free_endpoints
from tis.common.trace import Trace, parse_trace
from tis.deploy.net.far_end import FarEnd
from tis.deploy.net.probe import Plan, Probed, probe
from tis.deploy.net.reflector import Batch, Reflector, stamps_key

pytestmark = pytest.mark.live
_ROOT = Path(__file__).resolve().parents[3]
Reflect = Callable[..., "subprocess.Popen[str]"]
PLAN = Plan("tis/net/probe", rate_hz=200, n_messages=100, n_bytes=16, timeout_s=1.0, wait_s=5.0)


@pytest.fixture
def reflect() -> Iterator[Reflect]:
    """Start far ends; return each when it is ready."""
    started: list[subprocess.Popen[str]] = []

    def start(endpoint: str, skew: str = "") -> "subprocess.Popen[str]":
        process = subprocess.Popen(
            [sys.executable, "-m", "tis.deploy.cli.main", "net", "reflect", "-l", endpoint],
            env={**os.environ, SKEW_VARIABLE: skew}, cwd=_ROOT, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        started.append(process)
        assert process.stderr is not None
        assert "far end of probes on tis/net/probe" in process.stderr.readline()
        return process

    yield start
    for process in started:
        process.kill()
        process.communicate()


def _probe(*words: str) -> tuple[int, str, str]:
    code, out, err = call("net", "probe", "--reflector", *words)
    return code, out, " ".join(err.split())


def _read(path: Path) -> tuple[Trace, list[float]]:
    text = path.read_text()
    _, _, rows = text.partition("sent_s,delay_ms,uncertainty_ms\n")
    return parse_trace(text, "t"), [float(row.split(",")[2]) for row in rows.splitlines()]


def test_one_way_to_a_clock_three_seconds_ahead_and_fifty_ppm_fast(reflect: Reflect, tmp_path: Path) -> None:
    endpoint, _ = free_endpoints()
    there = reflect(endpoint, "3:50")
    target = tmp_path / "t.csv"
    code, out, err = _probe("-e", endpoint, "--rate-hz", "200", "--count", "500", "-o", str(target), "--json")
    assert code == 0, err
    trace, unsure_ms = _read(target)
    said = json.loads(out)
    assert len(trace.sent_ns) + int(trace.about["skipped"]) == 500
    assert said["n_lost"] == 0
    assert len(unsure_ms) == len(trace.sent_ns)
    assert min(unsure_ms) > 0
    assert "exchanges over the same path" in trace.about["clock"]
    assert re.match(r"far end ahead by [0-9.]+ ms", trace.about["clock_offset"])
    assert "ppm" in trace.about["clock_drift"]
    assert trace.about["uncertainty"].startswith("±")
    assert said["uncertainty_ms"]["p50"] > 0
    there.send_signal(signal.SIGINT)
    assert there.wait(5) == 0
    assert there.stderr is not None
    assert "messages stamped" in there.stderr.read()


def test_on_one_host_the_clock_is_shared_and_exact(reflect: Reflect, tmp_path: Path) -> None:
    endpoint, _ = free_endpoints()
    reflect(endpoint)
    target = tmp_path / "t.csv"
    code, out, err = _probe("-e", endpoint, "--count", "40", "-o", str(target))
    assert code == 0, err
    assert "uncertainty" not in target.read_text()
    assert parse_trace(target.read_text(), "t").about["clock"].startswith("shared")
    assert "±" not in out


def test_a_far_end_that_is_not_there_is_one_line() -> None:
    router, nobody = free_endpoints()
    with a_router(router):
        code, out, err = _probe("-e", router, "--wait-s", "0.3")
    assert (code, out) == (3, "")
    assert err == "tis: tis net probe: --reflector: no `tis net reflect` answers on tis/net/probe within 0.3 s"
    code, out, err = _probe("-e", nobody, "--wait-s", "0.3")
    assert (code, out) == (3, "")
    assert "no answer within 0.3 s" in err


def test_what_came_before_a_far_end_died_is_kept_and_said(reflect: Reflect, tmp_path: Path) -> None:
    endpoint, _ = free_endpoints()
    there = reflect(endpoint, "-3:20")
    target = tmp_path / "t.csv"
    killer = threading.Timer(4.0, there.kill)
    killer.start()
    code, out, err = _probe(
        "-e", endpoint, "--rate-hz", "100", "--seconds", "60", "--wait-s", "2", "--timeout-s", "0.5",
        "-o", str(target),
    )  # fmt: skip
    killer.join()
    assert code == 0, err
    assert "warning: the far end did not answer for 2 s" in err
    trace, _ = _read(target)
    assert 50 < len(trace.sent_ns) < 600
    assert trace.delay_ns[-1] >= 0
    assert (trace.delay_ns >= 0).mean() > 0.9
    assert "later ones do not count" in trace.about["ended"]
    assert "lost" in out


def _to_far_end(sender: zenoh.Session, plan: Plan = PLAN) -> tuple[Probed, FarEnd]:
    far = FarEnd(sender, plan)
    try:
        far.meet()
        return probe(sender, far, plan), far
    finally:
        far.close()


def test_the_true_offset_lies_within_what_is_said(reflect: Reflect) -> None:
    """Both processes read one clock in truth, so what the other one shows is known at every instant."""
    endpoint, _ = free_endpoints()
    reflect(endpoint, "3:50")
    with a_client(endpoint) as here:
        probed, _ = _to_far_end(here, PLAN._replace(n_messages=400))
    for at_ns in probed.exchanges.asked_ns:
        truth_ns = 3_000_000_000 + int(at_ns) * 50_000 // 10**9
        found_ns = int(probed.clock.to_reference_ns(at_ns)) - int(at_ns)
        assert abs(found_ns - truth_ns) <= int(probed.clock.uncertainty_ns(at_ns)) + 1
    assert not probed.clock.shared
    assert len(probed.exchanges) >= 20
    assert probed.paired.n_impossible == 0


def test_it_goes_through_an_emulator_as_messages_do() -> None:
    over = threading.Event()
    with a_bridge(**delays(20)) as bridged:
        reflector = Reflector(bridged.east, PLAN.key)
        thread = threading.Thread(target=reflector.serve, args=(over.is_set,))
        thread.start()
        try:
            probed, _ = _to_far_end(bridged.west)
        finally:
            over.set()
            thread.join()
            reflector.close()
    came = probed.paired.delay_ns >= 0
    assert came.sum() >= 0.9 * len(came)
    assert probed.paired.delay_ns[came].min() > 19_000_000


def test_one_far_end_serves_probe_after_probe_in_many_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tis.deploy.net.reflector.MAX_ROWS", 7)
    endpoint, _ = free_endpoints()
    over = threading.Event()
    with a_router(endpoint), a_client(endpoint) as here, a_client(endpoint) as session:
        reflector = Reflector(session, PLAN.key)
        thread = threading.Thread(target=reflector.serve, args=(over.is_set,))
        thread.start()
        try:
            for _ in range(2):
                probed, far = _to_far_end(here)
                assert not far.unavailable()
                assert (probed.paired.delay_ns >= 0).all()
                assert probed.paired.n_foreign == 0
                assert len(probed.sent_ns) + probed.n_skipped == PLAN.n_messages
                assert probed.clock.shared
        finally:
            over.set()
            thread.join()
            reflector.close()


def test_two_far_ends_on_one_key_are_refused() -> None:
    endpoint, _ = free_endpoints()
    with a_router(endpoint) as router, a_client(endpoint) as here:
        for name in ("one", "two"):
            payload, about = Batch(name, 0, 0, []).pack()

            def answer(query: zenoh.Query, payload: bytes = payload, about: bytes = about) -> None:
                query.reply(stamps_key(PLAN.key), payload, attachment=about)

            router.declare_queryable(stamps_key(PLAN.key), answer, complete=True)
        with pytest.raises(PeerError, match="several far ends answer here"):
            FarEnd(here, PLAN).meet()
