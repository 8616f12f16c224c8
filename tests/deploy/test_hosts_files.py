"""Files for containers and services: no engine runs here, so their commands and their limits are read."""

import importlib.util
import os
import shlex
from configparser import RawConfigParser
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml

from tests.deploy.commands import call
from tis.deploy.cli.main import app

_DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
_COMPOSE = {
    name: yaml.safe_load((_DEPLOY / "docker" / name).read_text()) for name in ("one_host.yaml", "three_hosts.yaml")
}
_SERVICES = [(name, side) for name, content in _COMPOSE.items() for side in content["services"]]


def _parse(words: list[str]) -> None:
    """Parse a command line of tis; raises click's errors for what it does not know."""
    group: Any = typer.main.get_group(app)
    command = group.commands[words[0]]
    command.make_context(words[0], words[1:])


@pytest.mark.parametrize(("name", "side"), _SERVICES)
def test_each_service_runs_one_side_without_rights_that_it_does_not_need(name: str, side: str) -> None:
    service: dict[str, Any] = _COMPOSE[name]["services"][side]
    words = [str(word) for word in service["command"]]
    assert words[0] == side
    _parse(words)
    assert service["ulimits"]["rtprio"] >= 2
    assert "cap_add" not in service
    assert service["read_only"] is True
    assert "privileged" not in service


def test_on_one_host_surgeon_and_patient_share_no_network_and_nobody_comes_in() -> None:
    content = _COMPOSE["one_host.yaml"]
    networks = {side: set(service["networks"]) for side, service in content["services"].items()}
    assert networks == {"netem": {"west", "east"}, "surgeon": {"west"}, "patient": {"east"}}
    assert all(network["internal"] for network in content["networks"].values())
    assert not any("ports" in service for service in content["services"].values())


def test_on_three_hosts_netem_listens_only_with_security() -> None:
    for service in _COMPOSE["three_hosts.yaml"]["services"].values():
        assert "--insecure" not in service["command"]


def test_the_scenario_of_the_containers_is_valid() -> None:
    code, _, err = call("validate", str(_DEPLOY / "docker" / "scenario.yaml"))
    assert code == 0, err


def test_the_image_runs_as_nobody_special_and_looks_after_its_health() -> None:
    lines = (_DEPLOY / "docker" / "Dockerfile").read_text().splitlines()
    last_stage = lines[max(i for i, line in enumerate(lines) if line.startswith("FROM ")) :]
    assert "USER tis" in last_stage
    assert any(line.startswith("HEALTHCHECK ") and line.endswith("/opt/tis/health.py") for line in last_stage)
    copied = [line.split()[1] for line in last_stage if line.startswith("COPY deploy/")]
    assert all((_DEPLOY.parent / path).exists() for path in copied)


def test_a_side_is_healthy_while_it_waits_and_while_it_writes(tmp_path: Path) -> None:
    spec = importlib.util.spec_from_file_location("health", _DEPLOY / "docker" / "health.py")
    assert spec is not None
    assert spec.loader is not None
    health = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(health)
    (tmp_path / "run").mkdir()
    log = tmp_path / "run" / "patient.mcap"
    for n_bytes, started_s, now_s, healthy in (
        (0, 50.0, 500.0, True),  # it waits for the others
        (40_000, 50.0, 109.0, True),
        (40_000, 50.0, 111.0, False),
        (40_000, 105.0, 500.0, True),  # of an earlier start
    ):
        log.write_bytes(bytes(n_bytes))
        os.utime(log, (100.0, 100.0))
        assert health.is_healthy(tmp_path, started_s, now_s) == healthy


def test_the_service_starts_a_side_in_real_time_and_ends_it_in_order() -> None:
    unit = RawConfigParser(strict=False, interpolation=None)
    unit.optionxform = str  # type: ignore[assignment, method-assign]
    unit.read(_DEPLOY / "systemd" / "tis@.service")
    service = unit["Service"]
    program, *words = shlex.split(service["ExecStart"])
    assert Path(program).name == "tis"
    for side in ("surgeon", "netem", "patient"):
        _parse([word.replace("%i", side) for word in words])
    assert service["KillSignal"] == "SIGINT"
    assert int(service["LimitRTPRIO"]) >= 2
    assert service["NoNewPrivileges"] == "yes"
