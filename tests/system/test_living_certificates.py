"""Certificates that are revoked and renewed while a run on three hosts goes on."""

import shutil
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.system.hosts import Hosts, hosts
from tis.common.audit import AUDIT_FILE, verify
from tis.common.runtime.credentials import load_certificates
from tis.deploy.tools.certificates import issue, new_authority, revoke

pytestmark = pytest.mark.live
__all__ = ["hosts"]
_TIS = [sys.executable, "-m", "tis.deploy.cli.main"]
_SCENARIO = """\
version: 1
name: living
duration_s: 20
source: {kind: synthetic}
hosts: {west: tls/10.77.1.1:7447, east: tls/10.77.2.1:7448}
security: {kind: mtls, sign: true, observers: [watcher], control: [operator]}
estimators: [hold]
active_estimator: hold
"""
_WATCHER = """
import sys, time, zenoh
from pathlib import Path
from tis.common.runtime.credentials import tls_settings
from tis.common.runtime.zenoh_session import ZenohOptions, configure
proof = tls_settings(Path(sys.argv[1]), listens=False)
n = 0
def take(_):
    global n
    n += 1
with zenoh.open(configure("client", ZenohOptions(connect=[sys.argv[2]], credentials=proof))) as session:
    session.declare_subscriber("tis/**", take)
    while True:
        time.sleep(0.25)
        print(n, flush=True)
"""


_STOPPER = """
import sys
from pathlib import Path
from tis.common.errors import InputError
from tis.common.runtime.emulator_client import EmulatorAddress
from tis.common.runtime.zenoh_session import ZenohOptions
from tis.deploy.net.emergency import release_all, stop_arms
operator, netem = (
    EmulatorAddress("tls/10.77.1.1:7447", options=ZenohOptions(config=Path(one))) for one in sys.argv[1:]
)
print(stop_arms(operator, "a hand").text, flush=True)
try:
    print(release_all(netem, {}), flush=True)
except InputError as error:
    print(error, flush=True)
print(release_all(operator, {}), flush=True)
"""


_MET = """
import socket, ssl, sys
from pathlib import Path
own = Path(sys.argv[1])
context = ssl.create_default_context(cafile=own / "ca.pem")
context.load_cert_chain(own / "cert.pem", own / "key.pem")
with socket.create_connection((sys.argv[2], int(sys.argv[3]))) as plain:
    with context.wrap_socket(plain, server_hostname=sys.argv[2]) as secured:
        print(secured.getpeercert()["serialNumber"], flush=True)
"""


def certificate_serial(place: Path) -> int:
    return load_certificates((place / "cert.pem").read_bytes())[0].serial_number


class _Processes:
    """Processes on the hosts, each with what it has said so far in a file."""

    def __init__(self, stack: ExitStack, hosts: Hosts, folder: Path) -> None:
        self._stack, self._hosts, self._folder = stack, hosts, folder
        self.running: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, name: str, host: str, *words: str) -> None:
        with (self._folder / f"{name}.txt").open("wb") as said:
            command = self._hosts.command(host, *words)
            process = subprocess.Popen(command, cwd=self._folder / host, stdout=said, stderr=subprocess.STDOUT)
        self._stack.callback(process.wait)
        self._stack.callback(process.kill)
        self.running[name] = process

    def said(self, name: str) -> str:
        return " ".join((self._folder / f"{name}.txt").read_text().split())

    def await_words(self, name: str, words: str) -> None:
        until_s = time.monotonic() + 60
        while words not in self.said(name):
            assert time.monotonic() < until_s, (words, {one: self.said(one) for one in self.running})
            time.sleep(0.05)


def test_a_revoked_name_is_shut_out_and_a_side_renews_its_certificate_in_one_run(
    hosts: Hosts, tmp_path: Path
) -> None:
    certs = tmp_path / "certs"
    (tmp_path / "s.yaml").write_text(_SCENARIO)
    new_authority(certs)
    for name in ("surgeon", "netem", "patient", "watcher", "operator"):
        issue(certs, name, ("10.77.1.1", "10.77.2.1") if name == "netem" else ())
        if name not in ("watcher", "operator"):
            shutil.copytree(certs / name, tmp_path / name / "certs" / name)
    with ExitStack() as stack:
        processes = _Processes(stack, hosts, tmp_path)
        for side in ("netem", "patient", "surgeon"):
            words = (*_TIS, side, str(tmp_path / "s.yaml"), "--run-dir", str(tmp_path / side), "--wait-s", "60")
            processes.start(side, side, *words)
        processes.await_words("patient", "running for")
        watch = (sys.executable, "-c", _WATCHER, str(certs / "watcher"), "tls/10.77.2.1:7448")
        processes.start("watcher", "patient", *watch)
        stoppers = [str(certs / name / "zenoh.json5") for name in ("operator", "netem")]
        processes.start("stopper", "surgeon", sys.executable, "-c", _STOPPER, *stoppers)
        processes.await_words("watcher", "1")

        processes.await_words("stopper", "released, confirmed and signed by the patient")
        said = processes.said("stopper")
        assert said.startswith("stopped, confirmed and signed by the patient after")
        assert "must be signed by one who may release" in said  # netem's certificate is none of these

        revoke(certs, "watcher")
        shutil.copy(certs / "revoked.txt", tmp_path / "netem" / "certs")
        processes.await_words("netem", "a client whose certificate is revoked from 10.77.2.2:")
        issue(certs, "surgeon")
        home = tmp_path / "surgeon" / "certs"
        shutil.copytree(certs / "surgeon", home / "new")
        (home / "surgeon").rename(home / "old")
        (home / "new").rename(home / "surgeon")
        processes.await_words("surgeon", "the certificate was renewed: the connection to netem was open again after")

        issue(certs, "netem")
        home = tmp_path / "netem" / "certs"
        shutil.copytree(certs / "netem", home / "new")
        (home / "netem").rename(home / "old")
        (home / "new").rename(home / "netem")
        processes.await_words("netem", "the certificate was renewed: open connections went on, new ones had to wait")
        met = (sys.executable, "-c", _MET, str(certs / "operator"), "10.77.2.1", "7448")
        processes.start("met", "patient", *met)
        processes.await_words("met", f"{certificate_serial(certs / 'netem'):X}")

        codes = {side: processes.running[side].wait(120) for side in ("surgeon", "netem", "patient")}
        assert codes == dict.fromkeys(codes, 0), {side: processes.said(side) for side in codes}
        heard = [int(word) for word in processes.said("watcher").split()]
    assert heard[-1] > 0
    assert heard[-8:] == [heard[-1]] * 8, "it hears nothing more, however often it connects"
    entries = verify((tmp_path / "netem" / AUDIT_FILE).read_bytes().splitlines(keepends=True)).entries
    cut = [one for one in entries if (one.event, one.what) == ("refused", "revoked")]
    where = {(one.name, one.network, one.address.rpartition(":")[0]) for one in cut}
    assert where == {("watcher", "east", "10.77.2.2")}
    asked = {(one.event, one.name) for one in entries if one.event in ("stop", "release")}
    assert asked == {("stop", "operator"), ("release", "not checked here")}
    for name, least in (("surgeon", 2), ("patient", 1), ("watcher", 2)):
        assert sum(one.n for one in entries if (one.event, one.name) == ("connected", name)) >= least
