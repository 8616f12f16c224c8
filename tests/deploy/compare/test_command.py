"""`tis compare` as a whole: what it writes, that it goes on where it stopped, and that a failure stays alone."""

import csv
import io
import json
import multiprocessing
import re
from pathlib import Path

import pytest
from rich.console import Console

from tests.deploy.commands import Call, call
from tis.deploy.compare import command
from tis.deploy.compare.cells.store import Store
from tis.deploy.compare.engine.compute import compute
from tis.deploy.compare.engine.workers import Processes
from tis.deploy.compare.plan import Request, make_plan
from tis.deploy.shell.progress import PhaseProgress


@pytest.fixture
def tis() -> Call:
    return call


def test_a_comparison_fails_alone_resumes_and_writes_every_form(
    tis: Call, small: Path, written_trials: Path, request: pytest.FixtureRequest
) -> None:
    folder = written_trials / "Suturing" / "kinematics" / "AllGestures"
    damaged = folder / "Suturing_U003.txt"
    damaged.write_text((folder / "Suturing_S001.txt").read_text().replace("0.0", "zero", 1))
    words = (
        "compare", "small.yaml", "--set", "identification.train=own_head", "--duration-s", "5",
        "--sweep", "network.forward.delay.delay_ms=33,200", "--out", "kept", "--jobs", "1",
    )  # fmt: skip
    try:
        code, out, err = tis(*words)
    finally:
        damaged.unlink()
    assert code == 5
    assert "training on the head of U003" in err
    assert "must be a number (got '-zero" in err.replace("\n", "")
    assert out.startswith("small: 2 of 3 synthetic trials (S001, T002); trained on")
    assert all(len(line) <= 80 for line in out.splitlines()[:-3])
    assert len(list(Path("kept/cells").iterdir())) == 4

    report = json.loads(Path("kept/table.json").read_text())
    assert report["synthetic"] == ["S001", "T002"]
    assert "% synthetic movement" in Path("kept/ratio.tex").read_text()
    assert "Synthetic movement. Bands" in Path("kept/curves.svg").read_text()
    assert '<li class="tag open">synthetic movement</li>' in Path("kept/comparison.html").read_text()
    assert Path("kept/table.md").read_text().startswith("small: 2 of 3 synthetic trials")
    ratios = {(row["estimator"], row["setting"]): row["ratio_to_hold"] for row in report["rows"]}
    assert ratios["hold", "33"] == ratios["hold", "200"] == 1
    assert ratios["damped_velocity", "33"] < ratios["damped_velocity", "200"] < 1
    assert {row["trial"] for row in report["by_trial"]} == {"S001", "T002"}
    pooled = list(csv.DictReader(Path("kept/table.csv").read_text().splitlines()))
    assert [(row["estimator"], row["setting"]) for row in pooled] == list(ratios)
    assert float(pooled[1]["ratio_to_hold"]) == ratios["damped_velocity", "33"]
    assert len(list(csv.DictReader(Path("kept/trials.csv").read_text().splitlines()))) == 8
    assert Path("kept/curves.svg").read_bytes().startswith(b"<?xml")
    assert Path("kept/error_by_age.svg").is_file()
    assert f"| damped_velocity | {ratios['damped_velocity', '33']:.3f} (" in Path("kept/table.md").read_text()

    # The same again, without the damaged trial: nothing is left to compute, not even a process is begun.
    request.getfixturevalue("without_figures")
    code, again, err = tis(*words)
    assert code == 0
    assert "4 of 4 twins were computed before" in err
    assert _figures(again) == _figures(out)
    code, data, again = tis(*words, "--json")
    assert code == 0
    assert json.loads(data) == json.loads(Path("kept/table.json").read_text())
    assert _figures(again) == _figures(out)

    # What is lost or damaged is computed again, and is what it was: here, too, and in another process before.
    request.getfixturevalue("in_this_process")
    first, second, *_ = sorted(Path("kept/cells").iterdir())
    before = json.loads(first.read_text())
    first.unlink()
    second.write_text("{")
    code, again, err = tis(*words)
    assert code == 0
    assert "2 of 4 twins were computed before" in err
    assert _figures(again) == _figures(out)
    assert json.loads(first.read_text())["hands"]["left"]["sst_m2"] == before["hands"]["left"]["sst_m2"]


def _figures(out: str) -> list[str]:
    """Return the table of ratios, which has no times in it."""
    return re.findall(r"^(?:hold|damped_velocity) +[\d. ]+$", out[out.index("Ratio to hold") :], re.MULTILINE)


def test_an_interrupt_keeps_what_is_done_and_leaves_no_process(small: Path, tmp_path: Path) -> None:
    plan = make_plan(Request(str(small), n_seeds=3, duration_s=3.0))
    store = Store(tmp_path / "kept")
    before = set(multiprocessing.active_children())

    class Interrupting(PhaseProgress):
        def advance(self, phase: str, n_parts: int = 1) -> None:
            if (phase, n_parts) == ("twins", 1):
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), Processes(1) as workers:
        compute(plan.cells, plan.trainings, store, workers, Interrupting(Console(quiet=True)))
    assert set(multiprocessing.active_children()) == before
    kept = [cell for cell in plan.cells if store.cell(cell.digest) is not None]
    assert len(kept) == 1


def test_an_interrupt_says_what_lies_in_the_folder(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = make_plan(Request(str(small), n_seeds=3, duration_s=3.0))
    store = Store(tmp_path / "kept")

    def interrupted(*_: object) -> None:
        first, second = plan.trainings
        for digest in (first, second):
            store.save_training(digest, {"train_s": {}, "warnings": []}, b"{}")
        store.model_file(second).unlink()
        for cell in plan.cells[:4]:
            store.save_cell(cell.digest, {"trial": cell.trial, "hands": {}})
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "compute", interrupted)
    err = io.StringIO()
    with pytest.raises(KeyboardInterrupt):
        command.run(plan, store, Processes(1), Console(file=err, width=200))
    kept = f"1 of 2 models and 4 of 6 twins are stored in {store.path}"
    size = "6 twins, 0.3 min of movement in all, 2 trainings"
    assert err.getvalue() == f"{size}\ninterrupted: {kept}; the same command resumes there\n"


def test_where_nothing_is_scored_the_reason_is_said_and_nothing_else(
    tis: Call, small: Path, in_this_process: None
) -> None:
    words = ("compare", "small.yaml", "--set", "identification.train=own_head", "--out", "kept", "--jobs", "1")
    code, out, err = tis(*words, "--duration-s", "2", "--seeds", "3", "--json")
    assert (code, out) == (5, "")
    lines = [line for line in err.splitlines() if line.startswith("tis:")]  # a slow machine shows progress, too
    reason = (
        "ticks count from 2 s after the first arrival (at 0.100 s), when filters have settled, and the run lasts 2 s"
    )
    assert lines[0] == f"tis: S001, seed 1: no tick could be scored: {reason}"
    assert len(lines) == 6
    assert lines[-1] == "tis: and 1 more twins without a scored tick"
    assert not Path("kept/table.json").exists()


def test_one_trial_without_a_score_is_named_beside_the_table(
    tis: Call, small: Path, written_trials: Path, in_this_process: None, without_figures: None
) -> None:
    folder = written_trials / "Suturing" / "kinematics" / "AllGestures"
    short = folder / "Suturing_U003.txt"
    short.write_text("".join((folder / "Suturing_S001.txt").read_text().splitlines(keepends=True)[:60]))
    try:
        code, out, err = tis("compare", "small.yaml", "--trials", "S001,U003", "--out", "kept", "--jobs", "1")
    finally:
        short.unlink()
    assert code == 5
    assert "tis: U003, seed 1: no tick could be scored: ticks count from 2 s after" in err
    assert "S001" not in err
    assert "damped_velocity" in out
    assert len(json.loads(Path("kept/table.json").read_text())["unscored"]) == 1


def test_the_help_says_what_models_are_trained_on(tis: Call) -> None:
    code, out, _ = tis("compare", "--help")
    assert code == 0
    assert "--set identification.train=own_head" in " ".join(out.split())


def test_a_folder_of_results_holds_one_comparison_at_a_time(tis: Call, small: Path, in_this_process: None) -> None:
    words = ("compare", "small.yaml", "--trials", "S001", "--duration-s", "4", "--out", "kept", "--jobs", "1")
    code, _, err = tis(*words, "--sweep", "network.forward.delay.delay_ms=33,200")
    assert code == 0, err
    assert Path("kept/curves.svg").is_file()
    n_cells = len(list(Path("kept/cells").iterdir()))
    code, out, err = tis(*words, "--set", "topology=observer")
    assert code == 0, err
    names = ["cells.parquet", "comparison.html", "error_by_age.pdf", "error_by_age.svg", "orientation.csv"]
    names += ["ratio.tex", "table.csv", "table.json", "table.md", "trials.csv"]
    assert sorted(path.name for path in Path("kept").iterdir() if path.is_file()) == names
    assert len(list(Path("kept/cells").iterdir())) == n_cells + 1
    plain = " ".join(out.split())
    assert "how old the freshest sample is that has arrived, command or arm's position" in plain
    assert "the arm's positions are as late as the network makes them" in plain
    assert "Topology observer" in Path("kept/table.md").read_text()


def test_all_mistakes_of_a_call_are_named(tis: Call, small: Path, tmp_path: Path) -> None:
    code, out, err = tis(
        "compare", "small.yaml", "--estimators", "foo", "--trials", "X1", "--sweep", "surgeon.copies=0,2,99",
        "--set", "identification.order=foo", "--set", "a.b=1", "--duration-s", "-1",
    )  # fmt: skip
    assert (code, out) == (2, "")
    found = sorted(line.removeprefix("tis: ").partition(" (got")[0] for line in err.splitlines())
    order = "must be an integer >= 0 or one of auto, energy, gap, criterion, validation"
    assert found.pop(-2).startswith("tis compare: --estimators: no such estimator; there are hold, ")
    assert found == [
        "--duration-s: must be greater than 0",
        "--set: a.b: a: unknown key",
        f"--set: identification.order: {order}",
        "--sweep: surgeon.copies: must be at least 1",
        "--sweep: surgeon.copies: must be at most 64",
        "tis compare: --trials: no such Suturing trial; there are S001, T002",
    ]
    code, _, err = tis("compare", "small.yaml", "--estimators", "hold,", "--sweep", "seed", "--trials", "X1")
    assert code == 2
    assert len(err.splitlines()) == 3
    code, _, err = tis("compare", "small.yaml", "--set", "source.path=absent", "--sweep", "seed")
    assert code == 2
    assert len(err.splitlines()) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["small.yaml"]


def test_mistakes_are_lines_and_leave_nothing(tis: Call, small: Path, tmp_path: Path) -> None:
    for words, code, line in (
        (("compare",), 2, "tis compare: SCENARIO: is required"),
        (("compare", "small.yaml", "--estimators", "hold,fnord"), 2, "no such estimator"),
        (("compare", "small.yaml", "--estimators", "hold,"), 2, "must be names, separated by commas"),
        (("compare", "small.yaml", "--sweep", "seed"), 2, "must read a.b=VALUE,VALUE,..."),
        (("compare", "small.yaml", "--set", "source.path=absent"), 4, "does not exist (folder given by source.path)"),
        (("compare", "--page", "absent/p.md"), 4, "absent/p.md: cannot be written: No such file"),
        (("compare", "small.yaml", "--page", "p.md"), 2, "must be given without a scenario"),
    ):
        found, out, err = tis(*words)
        assert found == code, err
        assert line in err.replace("\n", " ")
        assert out == ""
    assert [path.name for path in tmp_path.iterdir()] == ["small.yaml"]
