"""The command line of the emulator, up to the point where it opens a session."""

from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from tis.common.errors import InputError
from tis.common.runtime.ports import free_endpoints
from tis.common.runtime.side_log import SideOptions
from tis.common.runtime.status import Status
from tis.common.scenario import Scenario
from tis.common.scenario.network import NetworkPart
from tis.netem.bridge.chosen_network import read_network
from tis.netem.bridge.command import netem_command
from tis.netem.bridge.standalone import Standalone, lines_on_the_network

PLACES = ["--west", "tcp/127.0.0.1:1", "--east", "tcp/127.0.0.1:2"]


def _library(name: str) -> dict[str, Any]:
    if name != "slow":
        raise LookupError("must be slow")
    return {"from_profile": "slow", "forward": {"delay": {"kind": "constant", "delay_ms": 300.0}}}


def _run(*words: str) -> tuple[int, str, list[SideOptions]]:
    started: list[SideOptions] = []

    def side(scenario: Scenario, options: SideOptions, status: Status) -> int:
        started.append(options)
        return 0

    app = typer.Typer()
    app.command()(netem_command(side, Path, _library))
    result = CliRunner().invoke(app, words)
    return result.exit_code, result.output + result.stderr, started


@pytest.mark.parametrize(
    ("log_dir", "said"), [(None, "not logging: --log"), (Path("runs/a"), "logging to runs/a/netem.mcap")]
)
def test_its_first_lines_say_whether_it_keeps_a_log(log_dir: Path | None, said: str) -> None:
    lines = lines_on_the_network(Standalone({}, NetworkPart(), log_dir=log_dir), {})
    assert sum(line.startswith(said) for line in lines) == 1
    assert sum("logging" in line for line in lines) == 1


def test_without_places_it_is_a_scenario_s_emulator(tmp_path: Path) -> None:
    file = tmp_path / "s.yaml"
    file.write_text("{version: 1, name: s, source: {kind: synthetic}}")
    code, _, started = _run(str(file), "--listen", "tcp/a:1", "--listen", "tcp/b:2", "--run-dir", str(tmp_path / "r"))
    assert code == 0
    assert [options.zenoh.listen for options in started] == [["tcp/a:1", "tcp/b:2"]]


@pytest.mark.parametrize("words", [[], ["a.yaml", "b.yaml"], ["demo/**"]])
def test_other_than_one_scenario_is_refused(words: list[str]) -> None:
    code, text, _ = _run(*words)
    assert code == 2
    assert "netem: SCENARIO: must be one scenario; for key expressions give the two networks, --west and" in text
    assert "(got [])" not in text


def test_a_file_that_is_no_network_is_named_before_the_networks_that_lack(tmp_path: Path) -> None:
    table = tmp_path / "data.csv"
    table.write_text("t,x\n0,1\n")
    code, text, _ = _run("--scenario-network", str(table))
    assert code == 2
    assert f"{table}: is a table, not a scenario: `tis import" in text


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([*PLACES[:2]], "netem: --east: is required, or --connect-east"),
        ([*PLACES, "--profile", "nope"], "netem: --profile: must be slow (got 'nope')"),
        ([*PLACES, "--set", "profile=nope"], "netem: --profile: must be slow (got 'nope')"),
        (
            [*PLACES, "--set", "forward.loss.model=burst"],
            "netem: --set: forward: loss: must be kind: bernoulli|burst",
        ),
        (
            [*PLACES, "--set", "forward.loss.mean_burst=3"],
            "netem: --set: forward.loss.mean_burst: forward.loss.p_loss: is required",
        ),
        ([*PLACES, "--unmatched", "drop"], "netem: --unmatched: must be 'refuse' or 'pass' (got 'drop')"),
        ([*PLACES, "--set", "forward.dely=1"], "netem: --set: forward.dely: unknown key, did you mean 'delay'?"),
        ([*PLACES, "--listen", "tcp/a:1"], "must not stand beside --west, --east"),
        (
            [*PLACES, "--set", "rules=[{key: /x, direction: both, pipeline: {}}]"],
            "netem: --set: rules.0.key: must be a Zenoh key expression: no empty chunk",
        ),
        (
            [*PLACES, "--cfg", 'listen/endpoints:["tcp/a:1"]'],
            "netem: --config, --cfg: must not give listen/endpoints: ",
        ),
        ([*PLACES, "--cfg", 'connect/endpoints:["tcp/a:1"]'], "must not give connect/endpoints: --west, --east, "),
        ([*PLACES, "--mode", "router"], "netem: --mode: must be client or peer (got 'router')"),
        (
            [*PLACES, "--query-target", "one"],
            "netem: --query-target: must be best_matching, all, all_complete (got 'one')",
        ),
        ([*PLACES, "demo//x"], "netem: KEYEXPR: must be a Zenoh key expression, like demo/** (got 'demo//x')"),
        ([*PLACES, "--scenario-network", "/no/such"], "/no/such: cannot be read: No such file or directory"),
    ],
)
def test_mistakes_are_said_in_a_line_each(words: list[str], said: str) -> None:
    code, text, _ = _run(*words)
    assert code == 2, text
    assert said in text
    assert "Traceback" not in text


def test_a_file_may_be_a_network_or_a_scenario_with_one_and_names_a_profile_itself(tmp_path: Path) -> None:
    loss = "{kind: bernoulli, p_loss: 0.1}"
    for text in (
        f"profile: slow\nforward: {{loss: {loss}}}",
        f"version: 1\nnetwork: {{profile: slow, forward: {{loss: {loss}}}}}",
    ):
        file = tmp_path / "n.yaml"
        file.write_text(text)
        where, network = read_network(file, None, ["feedback.delay={kind: constant, delay_ms: 5}"], "pass", _library)
        assert where == str(file)
        assert network.from_profile == "slow"
        assert network.forward.delay is not None
        assert network.forward.delay.kind == "constant"
        assert network.forward.delay.delay_ms == 300.0
        assert network.forward.loss is not None
        assert network.feedback.delay is not None
        assert network.unmatched == "pass"


def test_all_faults_of_a_network_file_come_at_once_under_its_own_fields(tmp_path: Path) -> None:
    file = tmp_path / "n.yaml"
    file.write_text(
        "west: {}\nforward: {delay: {kind: gama}, loss: {kind: gilbert}}\nrules:\n"
        "- {key: /demo/alarm, direction: forward, pipeline: {}}\n- {key: a, direction: west, pipeline: {}}\n"
    )
    code, text, _ = _run(*PLACES, "--scenario-network", str(file))
    assert code == 2
    for said in (
        "west: unknown key, did you mean 'forward'? (got {})",
        "forward.delay.kind: must be 'constant' or",
        "'trace', did you mean 'gamma'? (got 'gama')",
        "did you mean 'gilbert_elliott' or 'gilbert_pareto'? (got 'gilbert')",
        "rules.0.key: must be a Zenoh key expression: no empty chunk, and no slash at the beginning or end",
        "rules.1.direction: must be 'forward', 'feedback' or 'both', did you mean 'forward'? (got 'west')",
    ):
        assert said in text
    tied = "[{key: a, direction: both, pipeline: {}}, {key: a, direction: both, pipeline: {}}]"
    file.write_text(f"rules: {tied}")
    said = _run(*PLACES, "--scenario-network", str(file))[1]
    assert f"{file}: line 1: rules.1.key: names the same keys as rules.0.key" in said
    file.write_text("version: 1\nnetwork:\n  forward: {delay: {kind: gama}}\n")
    assert f"{file}: line 3: network.forward.delay.kind: must be" in _run(*PLACES, "--scenario-network", str(file))[1]
    file.write_text("# nothing yet\n")
    assert f"{file}: is empty" in _run(*PLACES, "--scenario-network", str(file))[1]


@pytest.mark.parametrize("settings", [[], ["profile=slow"], ["network.profile=slow"]])
def test_a_profile_beside_a_file_is_refused(tmp_path: Path, settings: list[str]) -> None:
    file = tmp_path / "n.yaml"
    file.write_text("forward: {delay: {kind: constant, delay_ms: 40}}")
    with pytest.raises(InputError, match="--profile: must not stand beside --scenario-network"):
        read_network(file, None if settings else "slow", settings, None, _library)


@pytest.mark.parametrize(
    ("profile", "settings", "delay"),
    [
        (None, ["forward.delay.delay_ms=80"], {"kind": "constant", "delay_ms": 80}),
        (None, ["network.forward.delay.delay_ms=80"], {"kind": "constant", "delay_ms": 80}),
        (None, ["forward.delay.mean_ms=8", "forward.delay.std_ms=1"], {"kind": "normal", "mean_ms": 8, "std_ms": 1}),
        (None, ["forward.delay.kind=normal", "forward.delay.mean_ms=8", "forward.delay.std_ms=1"], {
            "kind": "normal", "mean_ms": 8, "std_ms": 1,
        }),
        ("slow", ["forward.delay.delay_ms=80"], {"kind": "constant", "delay_ms": 80}),
        (None, ["profile=slow"], {"kind": "constant", "delay_ms": 300}),
        (None, ["network.profile=slow", "forward.delay=null", "forward.delay.delay_ms=7"], {
            "kind": "constant", "delay_ms": 7,
        }),
        ("slow", ["forward.delay=null"], None),
    ],
)  # fmt: skip
def test_settings_are_those_of_a_scenario_and_may_leave_the_kind_out(
    profile: str | None, settings: list[str], delay: dict[str, Any] | None
) -> None:
    _, network = read_network(None, profile, settings, None, _library)
    found = None if network.forward.delay is None else network.forward.delay.model_dump()
    assert found == delay


@pytest.mark.live
def test_a_file_among_the_keys_is_warned_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("my.yaml").write_text("{}")
    west, east = free_endpoints()
    code, text, _ = _run("--connect-west", west, "--connect-east", east, "--wait-s", "0", "my.yaml", "demo/**")
    assert code == 3, text
    assert "my.yaml is taken for a key; --scenario-network my.yaml makes it the network" in text
    assert "demo" not in text


def test_a_network_that_is_none_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "n.yaml"
    file.write_text("network: 5")
    with pytest.raises(InputError, match="must be a mapping"):
        read_network(file, None, [], None, _library)
