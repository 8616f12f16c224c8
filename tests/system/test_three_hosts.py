"""The three sides on three hosts: network namespaces of this machine, joined by two cables through netem's."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import pytest

from deploy.logs.read.load import load_run
from deploy.tools.certificates import issue, new_authority
from tests.deploy.commands import call
from tests.system.conftest import is_right_but_for_the_machine

pytestmark = pytest.mark.live
_ROOT = Path(__file__).resolve().parents[2]
_IP = shutil.which("ip") or "/usr/sbin/ip"
_TIS = [sys.executable, "-m", "deploy.cli.main"]

SCENARIO = """\
version: 1
name: three_hosts
duration_s: 3
source: {kind: synthetic}
hosts: {west: tls/10.77.1.1:7447, east: tls/10.77.2.1:7448}
security: {kind: mtls}
network: {forward: {delay: {kind: constant, delay_ms: 20}}, feedback: {delay: {kind: constant, delay_ms: 20}}}
identification: {train: MODEL_FILE}
"""


@dataclass(frozen=True)
class Hosts:
    """Names of the namespaces; netem's has an address on either cable, the others on one."""

    surgeon: str
    netem: str
    patient: str

    def command(self, side: str, *words: str) -> list[str]:
        return [_IP, "netns", "exec", getattr(self, side), *words]


def _ip(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([_IP, *words], capture_output=True, text=True, check=True)


def _cable(host: str, host_address: str, netem: str, netem_link: str, netem_address: str) -> None:
    _ip("-n", host, "link", "add", "eth0", "type", "veth", "peer", "name", netem_link, "netns", netem)
    for name, link, address in ((host, "eth0", host_address), (netem, netem_link, netem_address)):
        _ip("-n", name, "addr", "add", f"{address}/24", "dev", link)
        _ip("-n", name, "link", "set", link, "up")


@pytest.fixture
def hosts() -> Iterator[Hosts]:
    if not sys.platform.startswith("linux"):
        pytest.skip("network namespaces are Linux's")
    if os.geteuid() != 0:
        pytest.skip("only root may make network namespaces")
    if not Path(_IP).exists():
        pytest.skip("no `ip` command here: install iproute2")
    hosts = Hosts(*(f"tis-{os.getpid()}-{side}" for side in ("surgeon", "netem", "patient")))
    made: list[str] = []
    try:
        try:
            for name in (hosts.surgeon, hosts.netem, hosts.patient):
                _ip("netns", "add", name)
                made.append(name)
            _cable(hosts.surgeon, "10.77.1.2", hosts.netem, "west", "10.77.1.1")
            _cable(hosts.patient, "10.77.2.2", hosts.netem, "east", "10.77.2.1")
        except subprocess.CalledProcessError as error:
            pytest.skip(f"no network namespaces here: {error.stderr.strip()}")
        yield hosts
    finally:
        for name in made:
            subprocess.run([_IP, "netns", "del", name], check=False)


def test_sides_on_three_hosts_meet_in_any_order_and_their_logs_make_one_run(
    hosts: Hosts, tmp_path: Path, model_file: Path, without_report: None
) -> None:
    for side, other in (("surgeon", "10.77.2.1"), ("patient", "10.77.1.1")):
        found = subprocess.run(hosts.command(side, _IP, "route", "get", other), capture_output=True, check=False)
        assert found.returncode != 0, f"there is a way round netem: {found.stdout!r}"
    (tmp_path / "s.yaml").write_text(SCENARIO.replace("MODEL_FILE", str(model_file)))
    new_authority(tmp_path / "certs")
    for side in ("surgeon", "netem", "patient"):
        issue(tmp_path / "certs", side, ("10.77.1.1", "10.77.2.1") if side == "netem" else ())
        shutil.copytree(tmp_path / "certs" / side, tmp_path / side / "certs" / side)  # each host has its own only
    processes: dict[str, subprocess.Popen[str]] = {}
    with ExitStack() as stack:
        for side in ("patient", "surgeon", "netem"):  # whom the others wait for comes last
            words = [*_TIS, side, str(tmp_path / "s.yaml"), "--run-dir", str(tmp_path / side), "--wait-s", "60"]
            process = subprocess.Popen(
                hosts.command(side, *words),
                cwd=tmp_path / side, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            )  # fmt: skip
            processes[side] = stack.enter_context(process)
            stack.callback(process.kill)
        said = {side: process.communicate(timeout=120)[1] for side, process in processes.items()}
    assert {side: process.returncode for side, process in processes.items()} == dict.fromkeys(said, 0), said

    gathered = tmp_path / "gathered"
    gathered.mkdir()
    for side in processes:
        shutil.copy(tmp_path / side / f"{side}.mcap", gathered)
    code, out, err = call("summarize", str(gathered))
    summary = json.loads((gathered / "summary.json").read_text())
    assert summary["security"] == "mtls"
    assert not any(summary["refused"].values())
    assert is_right_but_for_the_machine(code, summary), out + err
    assert load_run(gathered).problems() == []
    assert "identical, bit for bit" in call("replay", str(gathered))[1]


def test_netem_does_not_listen_where_anybody_may_connect(tmp_path: Path) -> None:
    text = SCENARIO.replace("tls/", "tcp/").replace("security: {kind: mtls}\n", "").replace("train: MODEL_FILE", "")
    (tmp_path / "s.yaml").write_text(text)
    code, _, err = call("netem", str(tmp_path / "s.yaml"), "--run-dir", str(tmp_path / "run"))
    assert code == 2
    rule = (
        "must be on loopback without clients' certificates (mTLS) or passwords, unless --insecure says that anybody "
        "may connect"
    )
    assert err == f"netem: zenoh: --listen: {rule} (got 'tcp/10.77.1.1:7447')\n"
    assert not (tmp_path / "run").exists()
