"""Three hosts: network namespaces of this machine, joined by two cables through netem's."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

IP = shutil.which("ip") or "/usr/sbin/ip"


@dataclass(frozen=True)
class Hosts:
    """Names of the namespaces; netem's has an address on either cable, the others on one."""

    surgeon: str
    netem: str
    patient: str

    def command(self, side: str, *words: str) -> list[str]:
        return [IP, "netns", "exec", getattr(self, side), *words]


def ip(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([IP, *words], capture_output=True, text=True, check=True)


def cable(host: str, host_address: str, netem: str, netem_link: str, netem_address: str) -> None:
    ip("-n", host, "link", "add", "eth0", "type", "veth", "peer", "name", netem_link, "netns", netem)
    for name, link, address in ((host, "eth0", host_address), (netem, netem_link, netem_address)):
        ip("-n", name, "addr", "add", f"{address}/24", "dev", link)
        ip("-n", name, "link", "set", link, "up")


@pytest.fixture
def hosts() -> Iterator[Hosts]:
    if not sys.platform.startswith("linux"):
        pytest.skip("network namespaces are Linux's")
    if os.geteuid() != 0:
        pytest.skip("only root may make network namespaces")
    if not Path(IP).exists():
        pytest.skip("no `ip` command here: install iproute2")
    hosts = Hosts(*(f"tis-{os.getpid()}-{side}" for side in ("surgeon", "netem", "patient")))
    made: list[str] = []
    try:
        try:
            for name in (hosts.surgeon, hosts.netem, hosts.patient):
                ip("netns", "add", name)
                made.append(name)
            cable(hosts.surgeon, "10.77.1.2", hosts.netem, "west", "10.77.1.1")
            cable(hosts.patient, "10.77.2.2", hosts.netem, "east", "10.77.2.1")
        except subprocess.CalledProcessError as error:
            pytest.skip(f"no network namespaces here: {error.stderr.strip()}")
        yield hosts
    finally:
        for name in made:
            subprocess.run([IP, "netns", "del", name], check=False)
