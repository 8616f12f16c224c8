"""`tis compare` as a whole: what it writes, that it goes on where it stopped, and that a failure stays alone."""

import csv
import json
import multiprocessing
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from deploy.cli import app
from deploy.compare.plan import Request, make_plan
from deploy.compare.pool import compute
from deploy.compare.store import Store

Call = Callable[..., tuple[int, str, str]]


@pytest.fixture
def tis() -> Call:
    def call(*words: str) -> tuple[int, str, str]:
        result = CliRunner().invoke(app, list(words))
        assert "Traceback" not in result.output
        return result.exit_code, result.stdout, result.stderr

    return call


def test_a_comparison_fails_alone_resumes_and_writes_every_form(tis: Call, small: Path, written_trials: Path) -> None:
    folder = written_trials / "Suturing" / "kinematics" / "AllGestures"
    damaged = folder / "Suturing_U003.txt"
    damaged.write_text((folder / "Suturing_S001.txt").read_text().replace("0.0", "zero", 1))
    words = (
        "compare", "small.yaml", "--set", "identification.train=own_head", "--duration-s", "5",
        "--sweep", "network.forward.delay.delay_ms=33,200", "--out", "kept", "--jobs", "1", "--json", "t.json",
    )  # fmt: skip
    try:
        code, out, err = tis(*words)
    finally:
        damaged.unlink()
    assert code == 5
    assert "training on the head of U003" in err
    assert "must be a number (got '-zero" in err.replace("\n", "")
    assert all(len(line) <= 80 for line in out.splitlines()[:-3])
    assert len(list(Path("kept/cells").iterdir())) == 4

    report = json.loads(Path("t.json").read_text())
    assert report == json.loads(Path("kept/table.json").read_text())
    ratios = {(row["estimator"], row["setting"]): row["ratio_to_hold"] for row in report["rows"]}
    assert ratios["hold", "33"] == ratios["hold", "200"] == 1
    assert ratios["damped_velocity", "33"] < ratios["damped_velocity", "200"] < 1
    assert {row["trial"] for row in report["by_trial"]} == {"S001", "T002"}
    pooled = list(csv.DictReader(Path("kept/table.csv").read_text().splitlines()))
    assert [(row["estimator"], row["setting"]) for row in pooled] == list(ratios)
    assert float(pooled[1]["ratio_to_hold"]) == ratios["damped_velocity", "33"]
    assert len(list(csv.DictReader(Path("kept/trials.csv").read_text().splitlines()))) == 8
    assert Path("kept/ratio.svg").read_bytes().startswith(b"<?xml")
    assert Path("kept/error_by_age.svg").is_file()
    assert f"| damped_velocity | {ratios['damped_velocity', '33']:.3f} (" in Path("kept/table.md").read_text()

    # The same again, without the damaged trial: nothing is left to compute, not even a process is begun.
    code, again, err = tis(*words)
    assert code == 0
    assert "4 of 4 cells had been computed before" in err
    assert _figures(again) == _figures(out)

    # What is lost or damaged is computed again, and is what it was.
    first, second, *_ = sorted(Path("kept/cells").iterdir())
    before = json.loads(first.read_text())
    first.unlink()
    second.write_text("{")
    code, again, err = tis(*words)
    assert code == 0
    assert "2 of 4 cells had been computed before" in err
    assert json.loads(first.read_text())["hands"]["left"]["sst_m2"] == before["hands"]["left"]["sst_m2"]


def _figures(out: str) -> list[str]:
    """Return the table of ratios, which has no times in it."""
    return re.findall(r"^(?:hold|damped_velocity) +[\d. ]+$", out[out.index("Ratio to hold") :], re.MULTILINE)


def test_an_interrupt_keeps_what_is_done_and_leaves_no_process(small: Path, tmp_path: Path) -> None:
    plan = make_plan(Request(str(small), n_seeds=3, duration_s=3.0))
    store = Store(tmp_path / "kept")
    before = set(multiprocessing.active_children())

    def interrupt(n_cells: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        compute(plan, store, 1, interrupt)
    assert set(multiprocessing.active_children()) == before
    kept = [cell for cell in plan.cells if store.cell(cell.digest) is not None]
    assert len(kept) == 1


def test_mistakes_are_lines_and_leave_nothing(tis: Call, small: Path, tmp_path: Path) -> None:
    for words, code, line in (
        (("compare",), 2, "tis compare: SCENARIO: is required"),
        (("compare", "small.yaml", "--estimators", "hold,fnord"), 2, "no such estimator"),
        (("compare", "small.yaml", "--estimators", "hold,"), 2, "must be names, separated by commas"),
        (("compare", "small.yaml", "--sweep", "seed"), 2, "must read a.b=VALUE,VALUE,..."),
        (("compare", "small.yaml", "--set", "source.path=absent"), 4, "holds no Suturing trial"),
        (("compare", "small.yaml", "--page", "p.md"), 2, "computes what it needs"),
    ):
        found, out, err = tis(*words)
        assert found == code, err
        assert line in err.replace("\n", " ")
        assert out == ""
    assert [path.name for path in tmp_path.iterdir()] == ["small.yaml"]
