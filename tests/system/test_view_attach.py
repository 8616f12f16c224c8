"""`tis view` on a run that somebody else started, and on none."""

import os
import re
import signal
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.deploy.commands import call
from tests.system.browser import chromium, live_page
from tests.system.conftest import HOLD, StartHere, is_right_but_for_the_machine

pytestmark = pytest.mark.live

_ROOT = Path(__file__).resolve().parents[2]


@contextmanager
def a_view(endpoints: tuple[str, str], *words: str) -> Iterator["subprocess.Popen[str]"]:
    west, east = endpoints
    command = [sys.executable, "-m", "deploy.cli.main", "view", "--west", west, "--east", east, *words]
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


def test_it_begins_before_the_run_and_ends_with_it(run_here: StartHere, endpoints: tuple[str, str]) -> None:
    west, east = endpoints
    with a_view(endpoints) as view:
        with urllib.request.urlopen(_url(view), timeout=10) as page:
            assert "A run of the testbed, live" in page.read().decode()
        hosts = f"hosts={{west: {west}, east: {east}}}"
        tis = run_here("run", "default", "--duration-s", "3", *HOLD, "--set", hosts)
        out, err = view.communicate(timeout=120)
        assert (view.returncode, out, err) == (0, "", "the run is over\n")
    code, _, err = tis.wait()
    summary = tis.summary()
    assert is_right_but_for_the_machine(code, summary), (err, summary["problems"])
    assert f"netem joins {west} (west) and {east} (east)" in err


def test_a_page_whose_server_is_gone_says_so_calmly(endpoints: tuple[str, str]) -> None:
    with a_view(endpoints) as view, chromium() as browser:
        page, found = live_page(browser)
        page.goto(_url(view))
        page.get_by_text(f"Waiting for a run whose netem listens at {endpoints[0]}").wait_for()
        assert page.get_by_role("button", name="Cause an outage").is_disabled()  # there is nobody to ask
        view.send_signal(signal.SIGINT)
        page.get_by_role("alert").get_by_text("The connection to the page's server is lost").wait_for()
        page.set_viewport_size({"width": 700, "height": 700})  # nothing is sent to nobody
        page.wait_for_function("w => document.documentElement.scrollWidth <= w", arg=700)
        assert found == []


def test_nobody_there_is_exit_code_3_when_that_is_not_waited_for(
    endpoints: tuple[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    west, east = endpoints
    code, out, err = call("view", "--west", west, "--east", east, "--wait-s", "0.5")
    assert (code, out) == (3, "")
    page, said = err.splitlines()
    assert page.startswith("live page: http://")
    assert said == f"tis: tis view: {west}: no answer from a run within 0.5 s"


def test_an_address_that_is_not_ours_is_a_line(endpoints: tuple[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    west, east = endpoints
    code, out, err = call("view", "--west", west, "--east", east, "--address", "192.0.2.1")
    assert (code, out) == (2, "")
    assert err.startswith("tis: tis view: --address: cannot be listened on: ")
    assert len(err.splitlines()) == 1


def test_wider_than_loopback_the_address_has_a_token_and_ctrl_c_ends_it(endpoints: tuple[str, str]) -> None:
    with a_view(endpoints, "--address", "0.0.0.0", "--host", "localhost") as view:
        url = _url(view)
        assert re.fullmatch(r"http://localhost:\d+/\?token=[\w-]{32}", url)
        with urllib.request.urlopen(url, timeout=10) as page:
            assert page.status == 200
        with pytest.raises(urllib.error.HTTPError, match="403") as refused:
            urllib.request.urlopen(url.partition("?")[0], timeout=10)
        refused.value.close()
        view.send_signal(signal.SIGINT)
        assert view.communicate(timeout=120) == ("", "")
        assert view.returncode == 130
