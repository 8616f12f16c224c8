"""Hosts by ssh, against asyncssh's own server, which really runs the commands."""

import asyncio
import os
import sys
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import asyncssh
import pytest
import yaml

from tests.deploy.hosts.ssh_server import Server, ssh_server
from tests.deploy.hosts.stand_ins import RUNS, SCENARIO, SIDES, WAITS, Stage, environment, soon
from tis.common.errors import DataError, InputError, PeerError
from tis.common.extras import GET_HOSTS
from tis.deploy.hosts import connections
from tis.deploy.hosts.collect import gather_logs, newest_run
from tis.deploy.hosts.connections import connect_and_check, hosts_of
from tis.deploy.hosts.hosts_file import read_plan
from tis.deploy.hosts.protocol import RunRequest
from tis.deploy.hosts.up import SideWatch

pytestmark = pytest.mark.live
_RUN = "20260102_030405_hosts"


def _with_server(stage: Stage, act: Callable[[Server, Path], Awaitable[None]], **programs: str) -> None:
    """Write a hosts file of three hosts by ssh and act on it while the server runs."""

    async def main() -> None:
        async with ssh_server(stage.path / "ssh", environment()) as server:
            ssh: dict[str, object] = {
                "kind": "ssh", "address": "127.0.0.1", "port": server.port, "user": "tis", "key": "ssh/id",
                "known_hosts": "ssh/known_hosts",
            }  # fmt: skip
            file = stage.write(programs, SCENARIO, **dict.fromkeys(SIDES, ssh))
            await act(server, file)

    asyncio.run(main())


def _logs(stage: Stage, contents: dict[str, bytes], run: str = _RUN) -> None:
    for name, content in contents.items():
        folder = stage.path / "work" / "runs" / f"{run}_on_{name.partition('.')[0].partition('_')[0]}"
        folder.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)


def test_hosts_are_checked_and_logs_are_fetched_over_one_connection_each(tmp_path: Path) -> None:
    contents = {f"{side}.mcap": side.encode() * 100_000 for side in SIDES} | {"patient_2.mcap": b"again"}
    stage = Stage(tmp_path)

    async def act(server: Server, file: Path) -> None:
        _logs(stage, contents)
        _logs(stage, {"surgeon.mcap": b"x"}, "20270102_030405_hosts")  # of one host only
        plan = read_plan(file)
        hosts = hosts_of(plan)
        async with AsyncExitStack() as stack:
            await connect_and_check(stack, hosts, plan)
            assert await newest_run(hosts) == _RUN
            (tmp_path / "run").mkdir()
            await gather_logs(hosts, _RUN, tmp_path / "run", list[str]().append)
        assert len(server.connections) == 3

    _with_server(stage, act)
    assert {path.name: path.read_bytes() for path in (tmp_path / "run").iterdir()} == contents


def test_a_broken_connection_is_made_again_and_the_transfer_goes_on(tmp_path: Path) -> None:
    stage, told = Stage(tmp_path), list[str]()
    contents = {f"{side}.mcap": os.urandom(300_000) for side in SIDES}

    async def act(server: Server, file: Path) -> None:
        _logs(stage, contents)
        hosts = [one for one in hosts_of(read_plan(file)) if one.side == "patient"]
        (tmp_path / "run").mkdir()
        async with AsyncExitStack() as stack:
            await connect_and_check(stack, hosts, read_plan(file))
            server.cut_after_bytes = 100_000
            await gather_logs(hosts, _RUN, tmp_path / "run", told.append)
        assert len(server.connections) > 2

    _with_server(stage, act)
    assert (tmp_path / "run" / "patient.mcap").read_bytes() == contents["patient.mcap"]
    assert "continued after" in told[-1]
    assert not list((tmp_path / "run").glob("*.part"))


def test_a_host_with_another_key_is_refused_before_anything_is_sent(tmp_path: Path) -> None:
    async def act(server: Server, file: Path) -> None:
        other = asyncssh.generate_private_key("ssh-ed25519").export_public_key().decode()
        server.known_hosts.write_text(f"[127.0.0.1]:{server.port} {other}")
        async with AsyncExitStack() as stack:
            with pytest.raises(PeerError) as caught:
                await connect_and_check(stack, hosts_of(read_plan(file)), read_plan(file))
        texts = [str(fault) for fault in caught.value.faults]
        assert [text.partition(":")[0] for text in texts] == list(SIDES)
        assert all("its host key is not in" in text for text in texts)
        assert server.commands == []

    _with_server(Stage(tmp_path), act)


def test_files_that_cannot_be_used_are_named_for_each_host(tmp_path: Path) -> None:
    async def act(server: Server, file: Path) -> None:
        content: Any = yaml.safe_load(file.read_text())
        content["surgeon"]["known_hosts"] = "none"
        content["netem"]["key"] = "s.yaml"
        content["patient"] |= {"port": 1}
        file.write_text(yaml.safe_dump(content))
        async with AsyncExitStack() as stack:
            with pytest.raises((PeerError, DataError, InputError)) as caught:
                await connect_and_check(stack, hosts_of(read_plan(file)), read_plan(file))
        texts = [str(fault).replace(str(tmp_path), "") for fault in caught.value.faults]
        assert texts[0] == "surgeon: /none: cannot be read: No such file or directory; it holds the keys of the " \
            "hosts to trust"  # fmt: skip
        assert texts[1].startswith("netem: /s.yaml: is no private key")
        assert texts[2].startswith("patient: 127.0.0.1 port 1: cannot be reached: ")

    _with_server(Stage(tmp_path), act)


def test_the_logs_of_the_hosts_that_can_be_reached_are_collected(tmp_path: Path) -> None:
    async def act(server: Server, file: Path) -> None:
        _logs(Stage(tmp_path), {f"{side}.mcap": side.encode() for side in SIDES})
        content: Any = yaml.safe_load(file.read_text())
        content["netem"]["port"] = 1
        file.write_text(yaml.safe_dump(content))
        (tmp_path / "run").mkdir()
        hosts = hosts_of(read_plan(file))
        with pytest.raises(PeerError) as caught:
            await gather_logs(hosts, _RUN, tmp_path / "run", list[str]().append)
        assert [fault.where for fault in caught.value.faults] == ["netem"]
        for one in hosts:
            await one.host.close()

    _with_server(Stage(tmp_path), act)
    assert {path.name for path in (tmp_path / "run").iterdir()} == {"surgeon.mcap", "patient.mcap"}


def test_a_wrong_user_key_is_a_fault(tmp_path: Path) -> None:
    async def act(server: Server, file: Path) -> None:
        asyncssh.generate_private_key("ssh-ed25519").write_private_key(server.key)
        async with AsyncExitStack() as stack:
            with pytest.raises(PeerError, match="does not let us in"):
                await connect_and_check(stack, hosts_of(read_plan(file)), read_plan(file))

    _with_server(Stage(tmp_path), act)


def test_a_side_whose_connection_is_lost_ends_and_says_so_here(tmp_path: Path) -> None:
    """The program ignores what reaches it by the connection: the host's own `tis` ends it."""
    stage, events = Stage(tmp_path), list[Any]()

    async def act(server: Server, file: Path) -> None:
        plan = read_plan(file)
        [host] = [one for one in hosts_of(plan) if one.side == "patient"]
        async with AsyncExitStack() as stack:
            await connect_and_check(stack, [host], plan)
            request = RunRequest(folder=host.settings.folder, side="patient", scenario=SCENARIO, run=_RUN, wait_s=5)
            running = asyncio.create_task(SideWatch(host, request, events.append, lambda _: True).run())
            while not any(event["event"] == "running" for event in events):
                await asyncio.sleep(0.05)
            server.connections[-1].abort()
            end = await running
            assert end.exit_code == 3
            assert "the connection is lost" in end.reasons[0]
            assert await asyncio.to_thread(soon, stage.nobody_is_left)

    _with_server(stage, act, patient=RUNS + WAITS)
    assert events[-1]["event"] == "gone"


def test_without_the_package_the_command_that_installs_it_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ssh: dict[str, object] = {"kind": "ssh", "address": "10.0.0.2"}
    plan = read_plan(Stage(tmp_path).write({}, surgeon=ssh))
    monkeypatch.setattr(connections, "can_ssh", lambda: False)
    with pytest.raises(InputError) as caught:
        hosts_of(plan)
    rule = f"needs the package asyncssh: {GET_HOSTS}"
    assert [(fault.field, fault.rule) for fault in caught.value.faults] == [("surgeon.kind", rule)]


def test_the_command_line_does_not_load_asyncssh() -> None:
    code = "import sys, tis.deploy.cli.main, tis.deploy.hosts.up; sys.exit('asyncssh' in sys.modules)"
    assert os.spawnve(os.P_WAIT, sys.executable, [sys.executable, "-c", code], environment()) == 0
