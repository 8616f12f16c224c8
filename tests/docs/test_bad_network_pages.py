"""The emulator's how-to pages: their files and commands, as they are written, on ports of this test."""

import os
import re
import shlex
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path

import pytest
import zenoh

from tests.common.runtime.live_zenoh import a_client, settle, soon
from tests.deploy.commands import call
from tests.test_source import ROOT
from tis.common.runtime.emulator_client import EmulatorAddress, connected
from tis.common.runtime.ports import free_endpoints
from tis.common.runtime.zenoh_session import ZenohOptions, configure, open_client

_PAGES = ROOT / "docs" / "emulator"
_PATIENCE_S = 60
Run = Callable[..., "subprocess.Popen[str]"]


def blocks(page: str, language: str) -> list[str]:
    """Return the blocks of code of a page in one language."""
    text = (_PAGES / page).read_text(encoding="utf-8")
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)


def commands(block: str) -> list[list[str]]:
    """Return the words of each command of a shell block."""
    return [words for line in block.replace("\\\n", "").splitlines() if (words := shlex.split(line, comments=True))]


@pytest.fixture
def ports() -> dict[str, str]:
    """Return endpoints of this test for those that the pages name."""
    free = [*free_endpoints(), *free_endpoints()]
    return dict(zip((f"tcp/127.0.0.1:{port}" for port in (7447, 7448, 7501, 7502)), free, strict=True))


@pytest.fixture
def run(ports: dict[str, str], tmp_path: Path) -> Iterator[Run]:
    """Return a function that starts a command of a page, a `tis netem` up to its line *running*."""
    programs = {"tis": ("-m", "tis.deploy.cli.main"), "python": ()}
    with ExitStack() as stack:

        def start(words: list[str], *more: str, waits: bool = True) -> "subprocess.Popen[str]":
            rest = [ports.get(word, word).replace("examples/", f"{ROOT}/examples/") for word in (*words[1:], *more)]
            process = subprocess.Popen(
                [sys.executable, *programs[words[0]], *rest], cwd=tmp_path, env={**os.environ, "COLUMNS": "200"},
                stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            )  # fmt: skip
            stack.enter_context(process)
            stack.callback(process.kill)
            if waits and words[1] == "netem":
                await_line(process, "netem: running")
            return process

        yield start


def await_line(process: "subprocess.Popen[str]", begin: str) -> None:
    assert process.stderr is not None
    watchdog = threading.Timer(_PATIENCE_S, process.kill)
    watchdog.start()
    said = []
    try:
        for line in process.stderr:
            said.append(line)
            if line.startswith(begin):
                return
    finally:
        watchdog.cancel()
    raise AssertionError(said)


def counters(endpoint: str, prefix: str = "tis") -> Mapping[str, int]:
    """Return a netem's numbers of messages from west to east, by outcome."""
    with connected(EmulatorAddress(endpoint, prefix)) as remote:
        state = remote.state().forward
    assert state is not None
    return state.counters


@pytest.mark.live
def test_six_lines_do_what_others_do_as_root(run: Run, ports: dict[str, str], tmp_path: Path) -> None:
    (network,) = blocks("instead_of_tc.md", "yaml")
    assert len(network.splitlines()) == 6
    (tmp_path / "workshop.yaml").write_text(network)
    begin, change = blocks("instead_of_tc.md", "sh")
    start, subscribe, publish = commands(begin)
    run(start)
    west, east, *_ = ports.values()
    for words in commands(change):
        code, _, err = call(*words[1:], "-e", west)
        assert code == 0, err
    subscriber = run(subscribe, "-e", east)
    assert subscriber.stdout is not None
    assert subscriber.stdout.readline() == "subscribed\n"
    assert run(publish, "-e", west, "--rate-hz", "500").wait(_PATIENCE_S) == 0
    received = int(re.findall(r"received (\d+) ", subscriber.communicate(timeout=_PATIENCE_S)[0])[0])
    found = counters(west)
    assert found["offered"] == 500
    assert 0 < received <= found["released"]


@pytest.mark.live
def test_messages_queries_and_tokens_cross_three_emulators(run: Run, ports: dict[str, str]) -> None:
    for netem in [run(words, waits=False) for words in commands(blocks("chains_and_fleets.md", "sh")[0])]:
        await_line(netem, "netem: running")
    west, east, first, second = ports.values()
    with a_client(west) as operator, a_client(east) as robot:
        heard: list[str] = []
        seen: list[str] = []
        _held = [
            robot.declare_subscriber("demo/cmd", lambda sample: heard.append(sample.payload.to_string())),
            robot.declare_queryable("demo/state", lambda query: query.reply("demo/state", "well")),
            robot.liveliness().declare_token("demo/alive"),
            operator.liveliness().declare_subscriber(
                "demo/**", lambda sample: seen.append(str(sample.key_expr)), history=True
            ),
        ]
        assert soon(lambda: seen == ["demo/alive"])
        publisher = operator.declare_publisher("demo/cmd")
        n_sent = 0

        def one_comes() -> bool:
            nonlocal n_sent
            publisher.put(f"{n_sent}")
            n_sent += 1
            return bool(heard)

        assert soon(one_comes)
        for _ in range(100):
            one_comes()
        assert soon(lambda: any(reply.ok is not None for reply in operator.get("demo/state", timeout=5)))

        def what_one_releases_is_offered_to_the_next() -> bool:
            wifi, wan, cell = counters(west, "wifi"), counters(first, "wan"), counters(second, "cell")
            held = wifi["held_at_end"] + wan["held_at_end"] + cell["held_at_end"]
            return held == 0 and wifi["released"] == wan["offered"] and wan["released"] == cell["offered"]

        assert soon(what_one_releases_is_offered_to_the_next)
        found = counters(second, "cell")
        assert found["dropped.loss"] > 0
        assert soon(lambda: len(heard) >= found["released"] - 10)  # among them questions


@pytest.mark.live
def test_one_emulator_serves_robots_by_a_rule_for_each(run: Run, ports: dict[str, str], tmp_path: Path) -> None:
    (fleet,) = blocks("chains_and_fleets.md", "yaml")
    (tmp_path / "fleet.yaml").write_text(fleet.replace("p_loss: 0.5", "p_loss: 1"))
    (words,) = commands(blocks("chains_and_fleets.md", "sh")[1])
    run(words)
    west, east, *_ = ports.values()
    with ExitStack() as stack:
        heard: dict[str, int] = {}
        for name in ("robot1", "robot2", "robot3"):
            config = configure("client", ZenohOptions(connect=[east], cfg=[f'namespace:"{name}"']))
            opened = open_client(config, lambda: False, lambda: None)  # again and again, on a busy machine
            assert opened is not None
            robot = stack.enter_context(opened)

            def count(sample: zenoh.Sample, name: str = name) -> None:
                assert str(sample.key_expr) == "cmd"
                heard[name] = heard.get(name, 0) + 1

            stack.enter_context(robot.declare_subscriber("cmd", count))
            settle(robot)
        operator = stack.enter_context(a_client(west))
        for _ in range(20):
            for name in ("robot1", "robot2", "robot3"):
                operator.put(f"{name}/cmd", "go", congestion_control=zenoh.CongestionControl.BLOCK)
        assert soon(lambda: heard == {"robot1": 20, "robot3": 20})
        assert counters(west)["dropped.loss"] == 20


def test_the_profile_and_the_networks_of_the_page_are_valid(tmp_path: Path) -> None:
    found = []
    for text in blocks("describe_network.md", "yaml"):
        file = tmp_path / "my_link.yaml"
        file.write_text(text.replace("cell.up", str(tmp_path / "cell.up")))
        (tmp_path / "cell.up").write_text("1\n2\n")
        code, _, err = call("validate", str(file))
        assert code == 0, err
        found.append("a profile" if "a profile" in err else "a network")
    assert found.count("a profile") == 1
