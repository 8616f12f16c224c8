"""The command on a small study of its own, and a sample of the committed cells, which are computed again here."""

import json
from pathlib import Path

import pytest

from from_code.study_tables import as_json
from tests.deploy.commands import call_in_one_line as tis
from tis.deploy.bench.models import loss_table, tc_table
from tis.deploy.studies import tables
from tis.deploy.studies.reproduce import recompute
from tis.deploy.studies.reproduce.compared import compare, counted
from tis.deploy.studies.tables import committed, tables_in

SETTINGS = "--seeds 2 --duration-s 5 --set identification.train_samples=300"
DELAY = "--set 'network={forward: {delay: {kind: constant, delay_ms: 33}}}'"
SWEEP = "--sweep network.forward.delay.delay_ms=33,100"
HEADING = "Constant delay, synthetic"


@pytest.fixture
def study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_this_process: None) -> Path:
    """A folder of committed tables with one section, of which nothing is computed yet."""
    folder = tmp_path / "studies"
    folder.mkdir()
    command = f"tis compare default --estimators hold,velocity,adaptive_kf {SETTINGS} {SWEEP} {DELAY}"
    (folder / "estimators.sh").write_text(f"# {HEADING}\n{command}\n", "utf-8")
    (folder / "estimators.json").write_text("[]\n", "utf-8")
    monkeypatch.setattr(tables, "committed_folder", lambda: folder)
    monkeypatch.setattr(recompute, "committed_folder", lambda: folder)
    monkeypatch.chdir(tmp_path)
    return folder


def _reproduced(*words: str) -> tuple[int, str, str]:
    return tis("reproduce", "estimators", "--jobs", "1", *words)


def test_what_is_computed_again_is_equal_and_one_falsified_cell_is_found(study: Path) -> None:
    assert _reproduced()[0] == 5  # nothing to compare with
    found = _computed(study)
    for table in found:
        table["rows"].append(["adaptive_kf", *["0.5"] * (len(table["columns"]) - 1)])
    file = study / "estimators.json"
    file.write_text(as_json(found), "utf-8")
    code, out, err = _reproduced()
    assert (code, err.count("differ")) == (0, 0), err
    assert "within: 0.5 % or one unit of the last printed digit" in out
    cells = json.loads((study.parent / "runs" / "reproduce" / "estimators" / "cells.json").read_text("utf-8"))
    verdicts = {cell["verdict"] for cell in cells}
    assert verdicts == {"equal", "machine", "gone"}
    assert {cell["row"] for cell in cells if cell["verdict"] == "gone"} == {"adaptive_kf"}
    # a hand has made the velocity better at 100 ms
    text = file.read_text("utf-8")
    (row,) = [row for row in found[0]["rows"] if row[0].endswith(":velocity")]
    file.write_text(text.replace(json.dumps(row[2]), '"0.123 (0.10-0.15)"'), "utf-8")
    code, _, err = _reproduced("--quick")  # 33 ms alone
    assert code == 0, err
    code, _, err = _reproduced()
    assert code == 5
    assert f"table 1, {HEADING}: tis.patient_side.estimators:velocity, 100: 0.123 (0.10-0.15), now {row[2]}" in err


def _computed(study: Path) -> list[tables.Table]:
    """Return the tables of the study as its twins, which are kept, give them."""
    from tis.deploy.compare.engine.compute import workers_of
    from tis.deploy.shell.guard import ERR, OUT

    place = study.parent / "runs" / "reproduce" / "estimators"
    job = recompute.Job(place, False, 1, workers_of(1, None, ERR.print), OUT, ERR)
    return recompute.STUDIES["estimators"].recompute(job)


def test_a_sample_of_the_committed_cells_is_what_is_computed_here() -> None:
    page = f"## Loss\n\n{loss_table()}\n\n## Loss as tc-netem's published algorithm draws it\n\n{tc_table()}\n"
    cells = list(compare(committed("draws"), tables_in(page), recompute.STUDIES["network"].is_machine))
    found = counted(cells)
    assert "differs" not in found, [cell for cell in cells if cell.verdict == "differs"]
    assert found["equal"] > 20


def test_every_committed_command_is_understood() -> None:
    for _, command in recompute.commands("estimators"):
        given = recompute._given(command)
        assert given["estimators"].startswith("hold")
        assert "adaptive_kf" not in given["estimators"]
        assert len(given["sweeps"]) == 1
