"""`tis view` on a run that somebody else started and others disturb, and on none."""

import json
import os
import re
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from urllib.parse import urlsplit

import pytest
import zenoh

from tests.deploy.commands import call
from tests.nodes import a_pose
from tests.system.browser import chromium, live_page
from tests.system.conftest import RunHere, StartHere, is_right_but_for_the_machine
from tis.common.messages import Header, encode
from tis.common.runtime.zenoh_session import ZenohOptions, configure
from tis.netem.bridge.between import between

pytestmark = pytest.mark.live

_ROOT = Path(__file__).resolve().parents[2]


@contextmanager
def a_view(endpoints: tuple[str, str], *words: str) -> Iterator["subprocess.Popen[str]"]:
    west, east = endpoints
    command = [sys.executable, "-m", "tis.deploy.cli.main", "view", "--west", west, "--east", east, *words]
    with subprocess.Popen(
        command, cwd=_ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "COLUMNS": "200"},
    ) as process:  # fmt: skip
        try:
            yield process
        finally:
            if process.poll() is None:
                process.kill()


def _url(process: "subprocess.Popen[str]") -> str:
    assert process.stderr is not None
    line = process.stderr.readline()
    found = re.fullmatch(r"live page: (http://\S+)\n", line)
    assert found is not None, line
    return found[1]


def _speak_nonsense(west: str) -> None:
    config = configure("client", ZenohOptions(connect=[west]))
    whole = encode(a_pose(9.0))
    future = encode(a_pose(9.0, sample_ns=10**17))
    with zenoh.open(config) as session:
        key = "tis/MTML/measured_cp"
        session.put(key, b"")
        session.put(key, b"\xff" * 5000)
        session.put(key, whole)
        session.put(key, whole[:40], attachment=Header(4_000_000).pack())
        session.put(key, future, attachment=Header(4_000_001).pack())
        session.put("somebody/else", b"refused")
        session.delete(key)
        time.sleep(0.3)


def test_it_begins_before_the_run_and_ends_with_it_and_junk_on_our_keys_is_counted(
    run_here: StartHere, endpoints: tuple[str, str]
) -> None:
    def speak(run: RunHere) -> None:
        run.await_log("surgeon")
        _speak_nonsense(west)

    west, east = endpoints
    words = ("--duration-s", "5", "--set", "estimators=[hold, innovations_kf]")
    hosts = f"hosts={{west: {west}, east: {east}}}"
    with a_view(endpoints) as view:
        with urllib.request.urlopen(_url(view), timeout=10) as page:
            assert "A run of the testbed, live" in page.read().decode()
        tis = run_here("run", "default", *words, "--set", hosts, meanwhile=speak)
        out, said = view.communicate(timeout=120)
        assert (view.returncode, out) == (0, "")
        assert said.splitlines()[-1] == "it is over"  # the line before may have come with the address
    code, _, err = tis.wait()
    summary = tis.summary()
    assert is_right_but_for_the_machine(code, summary), (err, summary["problems"])
    assert f"netem joins {west} (west) and {east} (east)" in err
    # netem may itself lose one of the six on our key: they cross a link with 1 % loss
    assert summary["rejected"]["patient"] >= 4
    assert summary["links"]["forward"]["foreign"] == 7
    assert summary["ticks"]["missed"] <= (summary["ticks"]["count"] / 2 if summary["problems"] else 2)
    assert summary["problems"] or summary["accuracy"]["innovations_kf"]["ratio_to_hold"] < 1
    manifest = json.loads((tis.run_dir / "manifest.json").read_text())
    assert set(manifest["exit_codes"].values()) == {0}


@pytest.mark.slow
def test_a_wide_address_has_a_token_and_a_page_whose_server_is_gone_says_so_calmly(
    endpoints: tuple[str, str],
) -> None:
    with ExitStack() as stack:
        view = stack.enter_context(a_view(endpoints, "--address", "0.0.0.0", "--host", "localhost"))
        url = _url(view)
        assert re.fullmatch(r"http://localhost:\d+/\?token=[\w-]{32}", url)
        with urllib.request.urlopen(url, timeout=10) as there:
            assert there.status == 200
        with pytest.raises(urllib.error.HTTPError, match="403") as refused:
            urllib.request.urlopen(url.partition("?")[0], timeout=10)
        refused.value.close()
        page, found = live_page(stack.enter_context(chromium()))
        page.goto(url)
        page.get_by_text(f"Waiting for a run whose netem listens at {endpoints[0]}").wait_for()
        assert page.get_by_role("button", name="Cause an outage").is_disabled()  # there is nobody to ask
        view.send_signal(signal.SIGINT)
        page.get_by_role("alert").and_(page.locator("#lost")).wait_for()
        page.set_viewport_size({"width": 700, "height": 700})  # nothing is sent to nobody
        page.wait_for_function("w => document.documentElement.scrollWidth <= w", arg=700)
        assert view.communicate(timeout=120)[0] == ""
        assert view.returncode == 130
        page.wait_for_timeout(2500)
        # the question for a picture that was open when the server went is refused, and none is asked after it
        refused_urls = [one.partition(": ")[0] for one in found if not one.startswith("Failed to load resource")]
        assert [urlsplit(one).path for one in refused_urls] in ([], ["/picture"])
        assert len(found) == 2 * len(refused_urls)


def test_a_netem_by_itself_is_shown_and_takes_requests() -> None:
    with ExitStack() as stack:
        net = stack.enter_context(between(settings=["forward.delay.delay_ms=20"]))
        view = stack.enter_context(a_view((net.west, net.east)))
        page, found = live_page(stack.enter_context(chromium()))
        page.goto(_url(view))
        page.get_by_text("netem runs by itself, without surgeon and patient").wait_for()
        assert page.get_by_role("heading", name="What the operator sees").count() == 0
        page.get_by_role("row", name="delay constant delay_ms 20").wait_for()
        page.get_by_label("Outage, ms").fill("60000")
        page.get_by_role("button", name="Cause an outage").click()
        page.get_by_text("Cause an outage: done").wait_for()
        session = stack.enter_context(zenoh.open(configure("client", ZenohOptions(connect=[net.west]))))
        for _ in range(10):
            session.put("demo/a", b"")
        page.get_by_role("row", name="dropped outage 10 0").wait_for()
        assert net.counts()["forward"]["offered"] == 10, "the page adds nothing to what crosses"
        assert found == []


def test_nobody_there_is_exit_code_3_when_that_is_not_waited_for(
    endpoints: tuple[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    west, east = endpoints
    code, out, err = call("view", "--west", west, "--east", east, "--wait-s", "0.5")
    assert (code, out) == (3, "")
    page, awaited, said = err.splitlines()
    assert page.startswith("live page: http://")
    assert west in awaited
    assert said == f"tis: tis view: {west}: no answer from a run with prefix tis within 0.5 s"


def test_a_netem_with_another_prefix_is_named_and_not_waited_for() -> None:
    with between() as net:
        code, _, err = call("view", "--west", net.west, "--east", net.east, "--prefix", "lab")
    assert (code, "use --prefix tis" in err) == (3, True), err


def test_an_address_that_is_not_ours_is_a_line(endpoints: tuple[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    west, east = endpoints
    code, out, err = call("view", "--west", west, "--east", east, "--address", "192.0.2.1")
    assert (code, out) == (2, "")
    assert err.startswith("tis: tis view: --address: cannot be listened on: ")
    assert len(err.splitlines()) == 1
