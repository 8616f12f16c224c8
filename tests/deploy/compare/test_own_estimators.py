"""Estimators of the user's own in a comparison: in other processes, with what they cost and where they failed."""

import io
import json
from html import escape
from pathlib import Path

import pytest
from rich.console import Console
from typer.testing import CliRunner

from tests.documented_estimator import FILE, NAME, documented_estimator
from tis.common.errors import InputError
from tis.deploy.cli.main import app
from tis.deploy.compare.plan import Request, make_plan
from tis.deploy.compare.results import tables

FAILING = """
import time
from my_filter import AlphaBeta
from tis.patient_side.estimators.protocol import Estimate

class Filter(AlphaBeta):
    def step(self, state, playout, now_ns):
        if playout.arm.newest % 5 == 0:
            raise RuntimeError("index divisible")
        return super().step(state, playout, now_ns)

class Always(AlphaBeta):
    def step(self, state, playout, now_ns):
        return state, playout.arm.no_such_thing

class Late(AlphaBeta):
    def step(self, state, playout, now_ns):
        return (state, Estimate(None)) if playout.arm.newest < 0 else (state, playout.arm.no_such_thing)

class Slow(AlphaBeta):
    def step(self, state, playout, now_ns):
        begun = time.thread_time()
        while time.thread_time() < begun + 0.04:
            pass
        return super().step(state, playout, now_ns)

class Silent(AlphaBeta):
    def step(self, state, playout, now_ns):
        return state, Estimate(None)

def picky(model):
    raise LookupError(f"nothing for {model.arm}")
"""

# For an own estimator all models are tried: small ones, of few samples.
SMALL = ("identification.train=own_head", "identification.train_samples=120", "identification.block_rows=2")


@pytest.fixture
def there(small: Path, own_folder: Path) -> Path:
    (own_folder / FILE).write_text(documented_estimator())
    (own_folder / "failing_own.py").write_text(FAILING)
    return small


def compare(*words: str) -> tuple[int, str, str]:
    small = [word for setting in SMALL for word in ("--set", setting)]
    result = CliRunner().invoke(app, ["compare", "small.yaml", *small, "--duration-s", "6", *words])
    assert "Traceback" not in result.output, result.output
    return result.exit_code, result.stdout, result.stderr


def test_two_processes_compare_it_with_ours_and_what_fails_is_marked(
    there: Path, forked: None, without_figures: None
) -> None:
    names = f"hold,damped_velocity,{NAME},failing_own:Filter"
    words = ["--estimators", names, "--out", "kept", "--jobs", "2", "--trials", "S001"]
    words += ["--sweep", "network.forward.delay.delay_ms=33,100"]
    code, out, err = compare(*words)
    assert code == 0, err
    report = json.loads(Path("kept/table.json").read_text())
    rows = {(row["estimator"], row["setting"]): row for row in report["rows"]}
    assert len(rows) == 8
    for setting in ("33", "100"):
        own, failing = rows[NAME, setting], rows["failing_own:Filter", setting]
        assert own["ratio_to_hold"] < failing["ratio_to_hold"] < 1
        assert own["train_s"] is None
        assert own["coverage_pct"] > 80
        assert (own["faulty_steps"], rows["damped_velocity", setting]["faulty_steps"]) == (0, 0)
        assert failing["faulty_steps"] > 10
    (line,) = report["own_faults"]
    n_steps = sum(row["faulty_steps"] for row in report["rows"])
    assert line.startswith(f"* failing_own:Filter failed in {n_steps} of 360 steps of the twins in which it did")
    assert line.endswith("RuntimeError: index divisible (failing_own.py, line 9)")
    assert line in Path("kept/table.md").read_text()
    assert all(len(shown) <= 80 for shown in out.splitlines()[:-1])
    assert "failing_own:" in out
    assert "Filter *" in out

    code, _, err = compare(*words)
    assert "2 of 2 twins were computed before" in err


def test_what_fails_at_every_step_is_a_failed_row(there: Path, forked: None, without_figures: None) -> None:
    names = "hold,damped_velocity,failing_own:Always"
    code, out, err = compare("--estimators", names, "--out", "kept", "--jobs", "1", "--trials", "S001")
    assert code == 5
    report = json.loads(Path("kept/table.json").read_text())
    assert [row["estimator"] for row in report["rows"]] == ["hold", "damped_velocity"]
    assert [about["failed"] for about in report["settings"]] == [["failing_own:Always"]]
    [failed] = report["failed"]
    assert failed.startswith(
        "failing_own:Always: failed at every scored tick of a twin, and has no score: S001, seed 1, first at "
    )
    assert failed.endswith("(failing_own.py, line 14)")
    assert failed in err
    assert "Always failed" in out
    assert "failing_own:Always failed |" in Path("kept/table.md").read_text()
    assert "failing_own:Always & failed" in Path("kept/ratio.tex").read_text().replace("\\_", "_")


def test_what_fails_at_every_scored_tick_has_no_score_and_what_is_silent_has_a_star(
    there: Path, forked: None, without_figures: None
) -> None:
    names = "hold,failing_own:Late,failing_own:Silent,failing_own:Slow"
    code, out, err = compare("--estimators", names, "--out", "kept", "--jobs", "1", "--trials", "S001")
    assert code == 5, out
    report = json.loads(Path("kept/table.json").read_text())
    assert [row["estimator"] for row in report["rows"]] == ["hold", "failing_own:Silent", "failing_own:Slow"]
    assert "failing_own:Late: failed at every scored tick of a twin, and has no score: S001" in err
    n = report["rows"][1]["n_scored"]
    told = f"* failing_own:Silent gave no estimate at {n} of {n} scored ticks, where hold's is scored in its place"
    assert report["own_faults"] == [told]
    [warning] = [text for text in report["warnings"] if "live it would miss ticks" in text]
    assert warning.startswith("failing_own:Slow takes 4")
    assert "failing_own:Silent * |" in Path("kept/table.md").read_text()


def test_what_failed_in_some_steps_is_marked_in_every_file(there: Path, forked: None) -> None:
    words = ["--estimators", "hold,failing_own:Filter", "--out", "kept", "--jobs", "1", "--trials", "S001"]
    code, _, err = compare(*words, "--sweep", "network.forward.delay.delay_ms=33,100")
    assert code == 0, err
    (line,) = json.loads(Path("kept/table.json").read_text())["own_faults"]
    page = Path("kept/comparison.html").read_text()
    assert escape(line) in page.replace("\u00a0", " ")
    assert page.count("failing_own:Filter *") >= 4  # chip, table, legends and the script's names
    assert "failing_own:Filter *" in Path("kept/ratio.tex").read_text().replace("\\_", "_")
    assert f"% {line}" in Path("kept/ratio.tex").read_text()
    star = "* failed, or gave no estimate, at some ticks, where hold's is scored in its place"
    for name in ("curves.svg", "error_by_age.svg"):
        assert star in Path("kept", name).read_text()


def test_other_code_is_other_twins_and_the_same_models(there: Path, own_folder: Path) -> None:
    request = Request(str(there), ("identification.train=own_head",), ("hold", NAME), ("S001",))
    before, ours = make_plan(request), make_plan(Request(str(there), request.settings, ("hold",), ("S001",)))
    assert [cell.digest for cell in make_plan(request).cells] == [cell.digest for cell in before.cells]
    (own_folder / FILE).write_text(documented_estimator().replace("0.8, 0.5,", "0.7, 0.5,"))
    after = make_plan(request)
    assert {cell.digest for cell in after.cells}.isdisjoint(cell.digest for cell in before.cells)
    assert set(after.trainings) == set(before.trainings)
    again = make_plan(Request(str(there), request.settings, ("hold",), ("S001",)))
    assert [cell.digest for cell in again.cells] == [cell.digest for cell in ours.cells]


def test_a_factory_that_gives_none_ends_the_comparison_before_any_twin(there: Path, in_this_process: None) -> None:
    code, out, err = compare("--estimators", "hold,failing_own:picky", "--out", "kept", "--jobs", "1")
    assert (code, out) == (2, "")
    rule = "raised LookupError: nothing for PSM2 (failing_own.py, line 32), when it was given the model"
    assert f"tis: estimators: failing_own:picky: {rule}" in err.splitlines()
    assert sum("failing_own:picky" in line for line in err.splitlines()) == 1
    assert not Path("kept/cells").exists()
    assert not Path("kept/table.json").exists()


def test_names_that_stand_for_nothing_are_refused_at_once(there: Path) -> None:
    code, out, err = compare("--estimators", f"hold,{NAME},nope_own:F,{NAME}X")
    assert (code, out) == (2, "")
    assert err.splitlines() == [
        "tis: tis compare: nope_own:F: no module 'nope_own', "
        "neither in the current folder nor on Python's search path",
        f"tis: tis compare: {NAME}X: my_filter.py has no 'AlphaBetaX', did you mean 'AlphaBeta'?",
    ]
    assert not Path("runs").exists()


def test_a_sweep_may_name_one_too(there: Path) -> None:
    sweep = Request(str(there), (f"estimators=[hold, {NAME}]", "active_estimator=hold"), trials=("S001",))
    plan = make_plan(sweep)
    assert plan.estimators == ("hold", NAME)
    with pytest.raises(InputError, match="must read module:factory"):
        make_plan(Request(str(there), ("estimators=[hold, 'my filter:F']",), trials=("S001",)))


def test_a_long_name_is_broken_where_a_terminal_is_narrow() -> None:
    row = {
        "estimator": "a_long_name_of_a_package.filters:Filter", "setting": None, "r2_pct": [99.991] * 3,
        "rmse_3d_mm": 12.3, "ratio_to_hold": 0.123, "ratio_to_hold_interval_95": [0.12, 0.13], "coverage_pct": 95.0,
        "step_us": {"p50": 123, "p99": 1234}, "train_s": None, "n_people": 9, "faulty_steps": 1,
    }  # fmt: skip
    report = {
        "scenario": "s", "source": "synthetic", "trials": ["a"], "n_trials_asked": 1, "n_seeds": 1,
        "trained_on": "t", "topologies": [],
        "rows": [row], "orientation": [], "touch_and_sight": [], "sweep": None, "axes": [], "zipped": False,
        "settings": [{"setting": None, "n_cells": 1, "age_ms": {"p50": 1, "p99": 1}, "packets_per_s": 1.0,
                      "bytes_per_s": 1.0}],
    }  # fmt: skip
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(tables.view(report))
    shown = console.export_text()
    assert "99.99" in shown
    assert "…" not in shown
    for part in ("a_long_name_of_a_p", "ackage.filters:", "Filter *"):
        assert any(line.startswith(part) for line in shown.splitlines())
