"""Studies: a file, a value in Python and options mean the same; what is wrong is named by the file's own fields."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.deploy.commands import call
from tis.common.errors import DataError, InputError
from tis.common.yaml_text import load_yaml
from tis.deploy.compare.cells.store import Store
from tis.deploy.compare.command import plan_of_study_file
from tis.deploy.compare.grid import parse_sweep
from tis.deploy.compare.plan import MAX_TWINS, Plan, Request, make_plan
from tis.deploy.compare.study import Study, plan_study, read_study

ROOT = Path(__file__).resolve().parents[3]
DELAY = "network.forward.delay.delay_ms"
NOTHING_GIVEN: dict[str, Any] = dict.fromkeys(
    ("scenario", "settings", "sweeps", "zipped", "estimators", "trials", "people", "n_seeds", "seed", "duration_s")
)


def digests(plan: Plan) -> list[str]:
    return [cell.digest for cell in plan.cells]


def faults_of(text: str, there: Path, **given: Any) -> list[str]:
    (there / "s.yaml").write_text(text)
    with pytest.raises((InputError, DataError)) as caught:
        plan_of_study_file(Path("s.yaml"), NOTHING_GIVEN | given)
    return [re.sub(r"^s.yaml: line \d+", "s.yaml", str(one)).partition(" (got")[0] for one in caught.value.faults]


def test_a_fault_of_a_study_names_its_line(small: Path, tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text("scenario: small.yaml\nsettings:\n  seed: 1\n  surgeon.copies: 0\nseeds: 0\n")
    with pytest.raises(InputError, match=r"^s.yaml: line 5: seeds: must be at least 1"):
        plan_of_study_file(Path("s.yaml"), NOTHING_GIVEN)
    (tmp_path / "s.yaml").write_text("scenario: small.yaml\nsettings:\n  seed: 1\n  surgeon.copies: 0\n")
    with pytest.raises(InputError, match=r"^s.yaml: line 4: settings.surgeon.copies: must be at least 1"):
        plan_of_study_file(Path("s.yaml"), NOTHING_GIVEN)


def test_a_file_a_value_and_options_are_the_same_cells(small: Path, tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(f"""
scenario: small.yaml
settings: {{source.hands: [left], network.forward: {{delay: {{kind: constant, delay_ms: 1}}}}}}
axes: {{{DELAY}: {{first: 0, last: 200, count: 3}}, surgeon.copies: [1, 2]}}
estimators: [hold]
seeds: 2
duration_s: 4
people: [T]
""")
    axes: dict[str, Any] = {DELAY: np.linspace(0, 200, 3), "surgeon.copies": np.array([1, 2])}
    settings: dict[str, Any] = {
        "source.hands": ["left"], "network.forward": {"delay": {"kind": "constant", "delay_ms": 1}}
    }  # fmt: skip
    in_python = Study(
        scenario=str(small), settings=settings, axes=axes, estimators=("hold",), seeds=2, duration_s=4, people=("T",)
    )
    by_options = Request(
        str(small),
        ("source.hands=[left]", "network.forward={delay: {kind: constant, delay_ms: 1}}"),
        ("hold",),
        trials=("T002",),
        n_seeds=2,
        duration_s=4,
        sweeps=(parse_sweep(f"{DELAY}=0..200:3"), parse_sweep("surgeon.copies=1,2")),
    )
    of_file = plan_study(*read_study(tmp_path / "s.yaml"))
    assert [cell.setting for cell in of_file.cells[::2]] == ["0, 1", "0, 2", "100, 1", "100, 2", "200, 1", "200, 2"]
    assert digests(of_file) == digests(plan_study(in_python)) == digests(make_plan(by_options))


def test_a_new_value_and_a_new_axis_reuse_the_stored_cells(
    small: Path, tmp_path: Path, in_this_process: None, without_figures: None
) -> None:
    """What the file gains has the value that held before among its values."""
    text = f"scenario: small.yaml\npeople: [S]\nduration_s: 4\nestimators: [hold]\naxes:\n  {DELAY}: [33, 100"
    found = []
    for more in ("]", ", 200]", ", 200]\n  surgeon.copies: [1, 2]"):
        (tmp_path / "s.yaml").write_text(text + more)
        code, _, err = call("compare", "--study", "s.yaml", "--jobs", "1")
        assert code == 0, err
        found.append([line for line in err.splitlines() if "computed before" in line])
    assert found == [[], ["2 of 3 twins were computed before"], ["3 of 6 twins were computed before"]]
    assert len(list(Path("runs/compare/s/cells").iterdir())) == 6


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers(-9, 10**9) | st.floats(allow_nan=False, allow_infinity=False)
        | st.text(st.characters(codec="ascii", exclude_categories=["Cc"]), max_size=9),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from("abc"), inner, max_size=3),
        max_leaves=5,
    )
)  # fmt: skip
def test_a_setting_is_the_value_that_its_text_means(value: Any) -> None:
    (setting,) = Study(scenario="default", settings={"a.b": value}).request.settings
    path, _, text = setting.partition("=")
    assert (path, load_yaml(text, "here")) == ("a.b", value)


def test_an_axis_keeps_numbers_names_and_truth_apart() -> None:
    axes: dict[str, Any] = {"a": [33.0, 1, 1e-7, True, "starlink_2025", "33", "true"]}
    (sweep,) = Study(scenario="default", axes=axes).sweeps
    assert sweep.values == ("33", "1", "0.0000001", "true", "starlink_2025", "'33'", "'true'")
    assert [load_yaml(text, "here") for text in sweep.values][3:] == [True, "starlink_2025", "33", "true"]


def test_every_fault_of_a_file_comes_at_once_under_its_field(small: Path, tmp_path: Path) -> None:
    found = faults_of(
        f"""
setings: {{}}
settings: {{a..b: 1, y: 2001-02-03}}
axes:
  {DELAY}: {{first: 0, last: .inf, cout: 4}}
  surgeon.history: 7
  patient.tick_phase_ms: [[1]]
seeds: 0
zip: maybe
estimators: []
""",
        tmp_path,
    )
    assert found == [
        "s.yaml: scenario: is required",
        "s.yaml: setings: unknown key, did you mean 'settings'?",
        "s.yaml: settings.a..b: must be the path of a field, like network.forward.delay.delay_ms",
        "s.yaml: settings.y: must be text, a number, true, false, null, a list or a mapping",
        f"s.yaml: axes.{DELAY}.last: must be a finite number",
        f"s.yaml: axes.{DELAY}.count: is required",
        f"s.yaml: axes.{DELAY}.cout: unknown key, did you mean 'count'?",
        "s.yaml: axes.surgeon.history: must be a list of values, or {first: NUMBER, last: NUMBER, count: N}",
        "s.yaml: axes.patient.tick_phase_ms.0: must be a number, a name such as a profile's, or true or false",
        "s.yaml: seeds: must be at least 1",
        "s.yaml: zip: must be true or false",
        "s.yaml: estimators: must have at least 1 item",
    ]
    text = "scenario: small.yaml\naxes: {a: [1, 1.0], b: {first: 0, last: 1, count: 2}}\npeople: [S]\ntrials: [S001]"
    assert faults_of(text, tmp_path) == [
        "s.yaml: axes.a: values must be different",
        "s.yaml: people: must be given without trials",
    ]
    assert faults_of("scenario: a\naxes: {b: {first: 0, last: 1, count: 2, spacing: log}}", tmp_path) == [
        "s.yaml: axes.b: spacing: log needs numbers above 0"
    ]


def test_what_the_scenario_refuses_is_said_of_the_study_s_field(small: Path, tmp_path: Path) -> None:
    text = "scenario: small.yaml\nsettings: {surgeon.copies: 0}\naxes: {surgeon.history: [99999, 2]}\npeople: [X]"
    assert faults_of(text, tmp_path) == [
        "s.yaml: settings.surgeon.copies: must be at least 1",
        "s.yaml: axes.surgeon.history: must be at most 256",
        "s.yaml: people: no such Suturing person; there are S, T",
    ]
    found = faults_of("scenario: small.yaml\naxes: {seed: [1, 2]}", tmp_path)
    assert found == ["s.yaml: axes: cannot be swept: seeds takes several"]
    with pytest.raises(InputError, match=r"^Study: people: no such Suturing person"):
        plan_study(Study(scenario=str(small), people=("X",)))
    with pytest.raises(InputError, match=r"^Study: seeds: must be at least 1 \(got 0\)$"):
        Study(scenario="default", seeds=0)


def test_a_hostile_file_is_refused_before_anything_is_listed(small: Path, tmp_path: Path) -> None:
    axes = "".join(f"\n  a.b{i}: {{first: 0, last: 1, count: 1000}}" for i in range(3))
    found = faults_of(f"scenario: small.yaml\naxes:{axes}", tmp_path)
    assert found == ["s.yaml: axes: at most 100,000 combinations of settings can be compared at once"]
    found = faults_of("scenario: small.yaml\nseeds: 1000000", tmp_path)
    assert found == [
        f"s.yaml: seeds: at most {MAX_TWINS:,} twins can be compared at once: settings times trials times seeds"
    ]
    bomb = "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n"
    bomb += "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 12))
    (found_bomb,) = faults_of(bomb, tmp_path)
    assert "must have at most 100000 values, with every alias expanded" in found_bomb
    assert faults_of("scenario: " + "x" * 4_000_001, tmp_path)[0].startswith("s.yaml: ")
    assert faults_of("[1, 2]", tmp_path) == ["s.yaml: must be a mapping of keys to values"]


def test_a_folder_in_a_scenario_s_place_is_called_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (found,) = faults_of("scenario: .", tmp_path)
    assert found.startswith("s.yaml: scenario: is a folder, not a scenario: ")


@pytest.mark.parametrize("name", ["defaut", "~nobody/a.yaml", "x" * 300, '"a\\0b"'])
def test_a_scenario_that_is_none_is_the_study_s_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (found,) = faults_of(f"scenario: {name}", tmp_path)
    assert found.startswith("s.yaml: scenario: no such scenario: neither a file nor one of default, ")


def test_options_override_the_part_computed_and_nothing_else(small: Path, tmp_path: Path) -> None:
    text = "scenario: small.yaml\nseeds: 3\npeople: [S]\nestimators: [hold]"
    (tmp_path / "s.yaml").write_text(text)
    given = NOTHING_GIVEN | {"n_seeds": 1, "trials": "T002", "duration_s": 3.0}
    plan = plan_of_study_file(Path("s.yaml"), given)
    assert [cell.label for cell in plan.cells] == ["T002, seed 1"]
    found = faults_of(text, tmp_path, scenario="default", settings=("a.b=1",), sweeps=("c=1",), zipped=True)
    assert found == [
        f"tis compare: {option}: must be given without --study: s.yaml says it"
        for option in ("SCENARIO", "--set", "--sweep", "--zip")
    ]
    assert faults_of(text, tmp_path, duration_s=-1.0) == ["--duration-s: must be greater than 0"]
    assert faults_of(text, tmp_path, people="X") == ["tis compare: --people: no such Suturing person; there are S, T"]


def test_a_store_is_named_by_the_file_and_a_scenario_lies_beside_it(
    small: Path, tmp_path: Path, in_this_process: None, without_figures: None
) -> None:
    (tmp_path / "deep").mkdir()
    small.rename(tmp_path / "deep" / "small.yaml")
    (tmp_path / "deep" / "mine.yaml").write_text("scenario: small.yaml\nduration_s: 4\nestimators: [hold]")
    code, _, err = call("compare", "--study", "deep/mine.yaml", "--people", "S", "--jobs", "1")
    assert code == 0, err
    (cell,) = plan_study(*read_study(Path("deep/mine.yaml")), {"people": ("S",)}).cells
    assert Store(Path("runs/compare/mine")).cell(cell.digest) is not None


def test_the_study_of_the_manual_runs_in_a_small_form(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_this_process: None, without_figures: None
) -> None:
    text = (ROOT / "docs" / "testbed" / "compare_estimators.md").read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    (found,) = re.findall(r"```yaml\n(# (\S+)\n.*?)```", text, re.DOTALL)
    Path(found[1]).write_text(found[0])
    plan = plan_study(*read_study(Path(found[1])))
    assert len(plan.cells) == 11 * 3 * 10
    small = ("--seeds", "1", "--duration-s", "3", "--estimators", "hold", "--jobs", "1", "--json")
    code, out, err = call("compare", "--study", found[1], *small)
    assert code == 0, err
    assert len(json.loads(out)["rows"]) == 11 * 3
