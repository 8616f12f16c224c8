"""The hosts file: all faults at once, of the scenario too."""

import re
from pathlib import Path

import pytest
import yaml

from tis.common.errors import InputError
from tis.deploy.hosts.hosts_file import SshHost, read_plan

SCENARIO = """\
version: 1
name: s
source: {kind: synthetic}
hosts: {west: tcp/10.0.0.1:7447, east: tcp/10.0.0.1:7448}
"""


def _file(folder: Path, scenario: str = SCENARIO, **sides: object) -> Path:
    (folder / "s.yaml").write_text(scenario)
    content = {"scenario": "s.yaml"} | {side: {"kind": "local"} for side in ("surgeon", "netem", "patient")} | sides
    (folder / "h.yaml").write_text(yaml.safe_dump(content))
    return folder / "h.yaml"


def _faults(file: Path) -> list[str]:
    with pytest.raises(InputError) as caught:
        read_plan(file)
    return [re.sub(r": line \d+", "", str(fault)).replace(f"{file.parent}/", "") for fault in caught.value.faults]


def test_paths_are_relative_to_the_file_and_the_homes_are_known(tmp_path: Path) -> None:
    ssh = {"kind": "ssh", "address": "10.0.0.2", "key": "keys/id", "user": "tis"}
    plan = read_plan(_file(tmp_path, surgeon=ssh))
    host = plan.hosts.surgeon
    assert isinstance(host, SshHost)
    assert plan.local_file(str(host.key)) == tmp_path / "keys" / "id"
    assert plan.local_file(host.known_hosts) == Path.home() / ".ssh" / "known_hosts"
    assert (host.port, host.place, host.restart) == (22, "10.0.0.2", False)
    assert plan.scenario.name == "s"


@pytest.mark.parametrize("name", ["~nobody-at-all/s.yaml", "s" * 300], ids=["home", "long"])
def test_a_scenario_or_key_without_a_place_is_refused_in_words(tmp_path: Path, name: str) -> None:
    file = _file(tmp_path)
    file.write_text(file.read_text().replace("s.yaml", name))
    with pytest.raises(InputError, match="no such scenario"):
        read_plan(file)
    file = _file(tmp_path, surgeon={"kind": "ssh", "address": "10.0.0.2", "key": "~nobody-at-all/id"})
    assert read_plan(file).local_file("~nobody-at-all/id") == tmp_path / "~nobody-at-all/id"


def test_all_faults_of_both_files_come_at_once(tmp_path: Path) -> None:
    file = _file(
        tmp_path,
        SCENARIO + "duration_s: -1\n",
        surgeon={"kind": "ssh", "address": "-oProxyCommand=x", "port": 0},
        netem={"kind": "namespace", "namespace": "a b", "clock_skew": "fast"},
        patient={"kind": "telnet"},
    )
    assert _faults(file) == [
        "h.yaml: netem.clock_skew: must read OFFSET_S:DRIFT_PPM[:STEP_S@AFTER_S], as in 3:50 (got 'fast')",
        "h.yaml: netem.namespace: must be the name of a network namespace (got 'a b')",
        "h.yaml: patient.kind: must be 'ssh' or 'namespace' or 'local' (got 'telnet')",
        "h.yaml: surgeon.address: must be an IP address or a host's name, without port (got '-oProxyCommand=x')",
        "h.yaml: surgeon.port: must be at least 1 (got 0)",
        "s.yaml: duration_s: must be greater than 0 (got -1)",
    ]


def test_a_scenario_must_name_endpoints_that_other_hosts_reach(tmp_path: Path) -> None:
    file = _file(tmp_path, SCENARIO.partition("hosts:")[0])
    rule = "must name netem's endpoints as the other hosts reach them: hosts: {west: ENDPOINT, east: ENDPOINT}"
    assert _faults(file) == [f"h.yaml: scenario: {rule} (got 's.yaml')"]


def test_a_scenario_whose_name_makes_no_folder_is_refused(tmp_path: Path) -> None:
    file = _file(tmp_path, SCENARIO.replace("name: s", f"name: {'s' * 151}"))
    assert "must have a name of at most 150 characters" in _faults(file)[0]


def test_a_side_cannot_be_started_again_in_a_run_that_its_death_ends(tmp_path: Path) -> None:
    restarting = {"kind": "local", "restart": True}
    read_plan(_file(tmp_path, patient=restarting))
    file = _file(tmp_path, SCENARIO + "on_peer_loss: end\n", patient=restarting)
    rule = "needs on_peer_loss: continue in the scenario, where now a dead side ends the run"
    assert _faults(file) == [f"h.yaml: patient.restart: {rule} (got True)"]


def test_a_command_that_is_empty_or_not_closed_is_refused(tmp_path: Path) -> None:
    file = _file(tmp_path, netem={"kind": "local", "tis": "'tis"}, patient={"kind": "local", "tis": " "})
    assert [fault.partition(" (got")[0] for fault in _faults(file)] == [
        "h.yaml: netem.tis: must be a command, such as tis: No closing quotation",
        "h.yaml: patient.tis: must be a command, such as tis: must be a command, such as tis",
    ]


def test_the_name_of_a_shipped_scenario_is_found_after_the_files_beside(tmp_path: Path) -> None:
    file = _file(tmp_path)
    file.write_text(file.read_text().replace("s.yaml", "default"))
    assert _faults(file)[0].startswith("h.yaml: scenario: must name netem's endpoints")
    (tmp_path / "default").write_text(SCENARIO)
    assert read_plan(file).scenario.name == "s"
