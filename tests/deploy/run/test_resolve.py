"""From names and settings to a scenario: profiles lie beneath the file, settings above both."""

from pathlib import Path

import pytest

from tis.common.errors import InputError
from tis.common.scenario.reading import digest
from tis.deploy.run.resolve import resolve
from tis.deploy.shell.shipped_scenarios import shipped_names

HEAD = "version: 1\nname: s\nsource: {kind: synthetic}\n"


def test_every_shipped_scenario_builds() -> None:
    assert [resolve(name).name for name in shipped_names()] == shipped_names()


def test_the_papers_scenarios_are_the_papers_profiles() -> None:
    network = resolve("paper_6").network
    assert network.from_profile == "paper_6"
    assert network.forward.delay is not None
    assert network.forward.delay.kind == "uniform"
    assert (network.forward.delay.low_ms, network.forward.delay.high_ms) == (200, 5000)
    assert network.forward.ordering == "reorder"


def test_a_setting_changes_one_value_of_a_profile() -> None:
    delay = resolve(
        "default", ["network.profile=geo_satellite", "network.forward.delay.std_ms=3"]
    ).network.forward.delay
    assert delay is not None
    assert delay.kind == "gamma"
    assert (delay.shift_ms, delay.std_ms) == (238.5, 3)


def test_a_profile_that_is_set_replaces_the_files_link_and_nothing_else(tmp_path: Path) -> None:
    rule = "{key: tis/x, direction: forward, pipeline: {}}"
    text = "network: {unmatched: pass, forward: {loss: {kind: bernoulli, p_loss: 0.5}}, rules: [" + rule + "]}\n"
    (tmp_path / "s.yaml").write_text(HEAD + text)
    network = resolve(str(tmp_path / "s.yaml"), ["network.profile=transatlantic_fiber"]).network
    assert network.forward.loss is None
    assert network.unmatched == "pass"
    assert [rule.key for rule in network.rules] == ["tis/x"]


def test_the_order_of_settings_does_not_matter_to_the_profile() -> None:
    one = resolve("default", ["network.profile=geo_satellite", "network.forward.ordering=reorder"])
    other = resolve("default", ["network.forward.ordering=reorder", "network.profile=geo_satellite"])
    assert digest(one) == digest(other)


def test_null_takes_a_profile_away_and_a_stage_of_it() -> None:
    plain = resolve("paper_3", ["network.profile=null"]).network
    assert (plain.from_profile, plain.forward.delay) == (None, None)
    assert resolve("paper_3", ["network.forward.loss=null"]).network.forward.loss is None


def test_a_profile_within_a_setting_of_the_whole_network_works() -> None:
    network = resolve("default", ["network={profile: lindbergh_2001, feedback: {}}"]).network
    assert network.from_profile == "lindbergh_2001"
    assert network.feedback.delay is not None  # {} gives no stage, so it replaces none


@pytest.mark.parametrize(
    ("setting", "rule"),
    [
        ("network.profile=geo_satelite", "did you mean 'geo_satellite'"),
        ("network.profile=fnord", "tis net profiles"),
        ("network.profile=7", "must be text"),
        ("network.profile=[", "not YAML"),
    ],
)
def test_a_profile_that_is_none_is_refused(setting: str, rule: str) -> None:
    with pytest.raises(InputError, match=rule.replace("(", r"\(")):
        resolve("default", [setting])


def test_a_profile_of_ones_own_is_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine.yaml").write_text(
        "name: my_link\ntitle: Mine\nsources: {me: I said so}\n"
        "network: {forward: {delay: {kind: constant, delay_ms: 9}}}\n"
        "numbers: [{of: forward, source: me, basis: judgement}]\n"
    )
    assert resolve("default", ["network.profile=mine.yaml"]).network.from_profile == "my_link"
    Path("mine.yaml").write_text(Path("mine.yaml").read_text().replace("me: I said so", "'': x"))
    with pytest.raises(InputError) as caught:
        resolve("default", ["network.profile=mine.yaml"])
    assert all(str(fault).startswith("mine.yaml: ") for fault in caught.value.faults)


def test_a_stage_s_kind_may_be_left_to_what_is_set_of_it() -> None:
    """As in `tis netem --set` and `tis net set`; the default scenario has independent losses of 1 %."""
    loss = resolve("default", ["network.forward.loss.mean_burst=3"]).network.forward.loss
    assert loss is not None
    assert loss.model_dump(exclude_none=True) == {"kind": "burst", "p_loss": 0.01, "mean_burst": 3.0}
    with pytest.raises(InputError, match=r"--set: forward: loss: must be kind: bernoulli\|burst.*no kind has model"):
        resolve("default", ["network.forward.loss.model=burst"])
