"""The hosts file: a scenario, and the host of each of its three sides."""

import os
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal, get_args

from pydantic import AfterValidator, Field, StringConstraints, ValidationError

from tis.common.channels import Side
from tis.common.errors import Fault, InputError
from tis.common.runtime.clock import skewed
from tis.common.runtime.recordings import build_whole
from tis.common.runtime.scenario_files import lines_told, read_scenario
from tis.common.scenario import Scenario
from tis.common.scenario.base import Part, RuleText
from tis.common.scenario.faults import faults
from tis.deploy.net.profiles import library
from tis.deploy.run.resolve import is_file, scenario_path

_MAX_SCENARIO_CHARS: Final = 150
_NAME: Final = r"^[A-Za-z0-9_][A-Za-z0-9_.:%-]{0,252}$"


def _words(value: str) -> str:
    try:
        if not shlex.split(value):
            raise ValueError("must be a command, such as tis")
    except ValueError as error:
        raise ValueError(f"must be a command, such as tis: {error}") from None
    return value


def _skew(value: str) -> str:
    try:
        skewed(value, lambda: 0)()
    except InputError as error:
        raise ValueError(error.faults[0].rule) from None
    return value


Command = Annotated[str, AfterValidator(_words)]
Address = Annotated[
    str, StringConstraints(pattern=_NAME), RuleText("must be an IP address or a host's name, without port")
]
NamespaceName = Annotated[str, StringConstraints(pattern=_NAME), RuleText("must be the name of a network namespace")]
ClockSkew = Annotated[str, AfterValidator(_skew)]


class _Host(Part):
    folder: str = Field(
        ".", min_length=1, description="Working folder there, which must exist: relative paths of the scenario begin "
        "here, and logs are written below its runs/.",
    )  # fmt: skip
    tis: Command = Field("tis", description="The command `tis` there.")
    restart: bool = Field(
        False, description="Whether a side whose process dies during the run is started again, at most 5 times."
    )


class SshHost(_Host):
    """A host that is reached by ssh; its host key must be known."""

    kind: Literal["ssh"] = Field(description="ssh: another machine.")
    address: Address = Field(description="Address or name of the host.")
    port: int = Field(22, strict=True, ge=1, le=65_535, description="Port of its ssh server.")
    user: str | None = Field(None, min_length=1, description="User there; by default the one here.")
    key: str | None = Field(
        None, min_length=1, description="File of the private key, relative to this file; by default those of "
        "ssh-agent and ~/.ssh.",
    )  # fmt: skip
    known_hosts: str = Field(
        "~/.ssh/known_hosts", min_length=1, description="File of the host keys to accept, relative to this file."
    )

    @property
    def place(self) -> str:
        """The host in words."""
        return self.address if self.port == 22 else f"{self.address} port {self.port}"


class NamespaceHost(_Host):
    """A network namespace of this machine, entered by ``ip netns exec``."""

    kind: Literal["namespace"] = Field(description="namespace: a Linux network namespace of this machine.")
    namespace: NamespaceName = Field(description="Name of the namespace.")
    clock_skew: ClockSkew | None = Field(None, description="Known error of its clock, like 3:50 (TIS_CLOCK_SKEW).")

    @property
    def place(self) -> str:
        """The host in words."""
        return f"namespace {self.namespace}"


class LocalHost(_Host):
    """The machine on which the command runs."""

    kind: Literal["local"] = Field(description="local: this machine.")
    clock_skew: ClockSkew | None = Field(None, description="Known error of its clock, like 3:50 (TIS_CLOCK_SKEW).")

    @property
    def place(self) -> str:
        """The host in words."""
        return "this machine"


AnyHost = SshHost | NamespaceHost | LocalHost
_HostField = Annotated[AnyHost, Field(discriminator="kind")]


class HostsFile(Part):
    """A hosts file."""

    scenario: str = Field(
        min_length=1, description="The scenario: a file, relative to this one, or the name of a shipped one."
    )
    surgeon: _HostField = Field(description="Host of the surgeon's side.")
    netem: _HostField = Field(description="Host of the network emulator.")
    patient: _HostField = Field(description="Host of the patient's side.")

    def of(self, side: Side) -> AnyHost:
        """Return the host of a side."""
        host: AnyHost = getattr(self, side)
        return host


@dataclass(frozen=True)
class Plan:
    """Hosts and scenario as the files say, and the folder to which the hosts file's paths are relative."""

    file: Path
    hosts: HostsFile
    scenario: Scenario

    def local_file(self, path: str) -> Path:
        """Return a file of this machine that the hosts file names."""
        return _beside(self.file, path)


def read_plan(file: Path) -> Plan:
    """Read a hosts file and its scenario; raises `InputError` with all faults of both."""
    raw = read_scenario(file)
    found: list[Fault] = []
    hosts, scenario = None, None
    try:
        hosts = HostsFile.model_validate(raw)
    except ValidationError as error:
        found += faults(error, HostsFile, str(file))
    try:
        scenario = _scenario(raw, file)
    except InputError as error:
        found += error.faults
    if hosts is not None and scenario is not None:
        found += contradictions(str(file), hosts, scenario)
    if found or hosts is None or scenario is None:
        with lines_told(file):
            raise InputError(found)
    return Plan(file, hosts, scenario)


def contradictions(where: str, hosts: HostsFile, scenario: Scenario) -> list[Fault]:
    """Return the faults of a scenario that these hosts cannot run."""
    found = []
    if scenario.hosts == "auto":
        rule = "must name netem's endpoints as the other hosts reach them: hosts: {west: ENDPOINT, east: ENDPOINT}"
        found.append(Fault(where, "scenario", rule, hosts.scenario))
    if len(scenario.name) > _MAX_SCENARIO_CHARS:
        rule = f"must have a name of at most {_MAX_SCENARIO_CHARS} characters, as part of the names of folders"
        found.append(Fault(where, "scenario", rule, scenario.name))
    restarting = [side for side in get_args(Side) if hosts.of(side).restart]
    if restarting and scenario.peer_loss_policy(True) == "end":
        rule = "needs on_peer_loss: continue in the scenario, where now a dead side ends the run"
        found += [Fault(where, f"{side}.restart", rule, True) for side in restarting]
    return found


def _beside(file: Path, path: str) -> Path:
    """Return a path relative to the folder of a file; ``~`` is a home, unless its user is unknown."""
    return file.parent / os.path.expanduser(path)  # noqa: PTH111  Path.expanduser raises for an unknown user


def _scenario(raw: Mapping[str, Any], file: Path) -> Scenario | None:
    """Return the scenario with its profile's values; its relative paths are the hosts' and stay as they are."""
    name = raw.get("scenario")
    if not isinstance(name, str) or not name:
        return None  # the hosts file's own fault
    beside = _beside(file, name)
    path = beside if is_file(beside) else scenario_path(name)
    with lines_told(path):
        return build_whole(read_scenario(path), str(path), library)
