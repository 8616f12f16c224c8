"""`tis admissible` as a whole: what it finds and writes, that it resumes, and its mistakes line by line."""

import csv
import json
import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.deploy.commands import call_in_one_line
from tis.deploy.studies.admissible.evaluation import Evaluation, Judged

SMALL = """version: 1
name: small
drain_s: 0.2
source: {kind: synthetic, hands: [left]}
identification: {train_samples: 240, block_rows: 4, order: 0}
patient: {orientation: {methods: [hold], active: hold}}
estimators: [hold, damped_velocity]
active_estimator: damped_velocity
"""
LOSSY = """name: lossy
title: "Half of everything is lost"
sources: {made_up: "chosen for a test"}
network:
  forward: {delay: {kind: constant, delay_ms: 20}, loss: {kind: bernoulli, p_loss: 0.5}}
numbers:
  - {of: forward, source: made_up, basis: judgement}
"""
DELAY = "network.forward.delay.delay_ms"
LOSS = "network.forward.loss.p_loss"
QUICK = ("--seeds", "2", "--duration-s", "3.5", "--jobs", "1", "--tolerance", "0.1", "--out", "kept")


@pytest.fixture(autouse=True)
def small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_this_process: None) -> None:
    """The working folder holds a short scenario and a profile; all twins run in this process."""
    monkeypatch.chdir(tmp_path)
    Path("small.yaml").write_text(SMALL)
    Path("lossy.yaml").write_text(LOSSY)


@pytest.fixture
def without_figure(monkeypatch: pytest.MonkeyPatch) -> None:
    """Write the tables without the figure: for tests that do not look at it."""
    monkeypatch.setattr("tis.deploy.studies.admissible.command._figures", lambda _: {})


def tis(*words: str) -> tuple[int, str, str]:
    return call_in_one_line("admissible", "small.yaml", *words)


def kept() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(Path("kept/admissible.json").read_text())
    return found


def test_a_plane_is_found_drawn_written_and_resumed(request: pytest.FixtureRequest) -> None:
    words = [*QUICK, "--limit", "rmse_3d_mm=6", "--limit", "age_mean_ms<=150", "--over", f"{DELAY}=0..300"]
    words += ["--over", f"{LOSS}=0..0.8", "--profiles", "none", "--checks", "4", "--points", "10"]
    code, out, err = tis(*words)
    assert code == 0, err
    assert "small: networks in which rmse_3d_mm<=6 and age_mean_ms<=150 hold with 95 % confidence over 2" in out
    report = kept()
    for about in report["estimators"].values():
        assert 0 < about["share"] < 0.6
        assert about["alone"][DELAY] <= 150
        assert len(about["outline"]) == len(about["border"]) + 1
    # Every border point was judged admissible, and is a row of the table.
    inside = {
        (name, *point["at"].values())
        for point in report["points"]
        for name, found in point["verdicts"].items()
        if found["inside"]
    }
    border = {(n, *at.values()) for n, about in report["estimators"].items() for at in about["border"]}
    assert border <= inside
    rows = list(csv.DictReader(Path("kept/border.csv").read_text().splitlines()))
    assert {(row["estimator"], float(row[DELAY]), float(row[LOSS])) for row in rows} == border
    points = list(csv.DictReader(Path("kept/points.csv").read_text().splitlines()))
    assert len(points) == 2 * len(report["points"])
    assert {row["kind"] for row in points} == {"border", "check"}
    assert all((row["inside"] == "True") == (float(row["margin"]) <= 0) for row in points)
    assert Path("kept/admissible.svg").read_bytes().startswith(b"<?xml")

    request.getfixturevalue("without_figure")
    code, again, _ = tis(*words, "--json")
    assert code == 0
    assert json.loads(again)["estimators"] == report["estimators"]
    n_twins = report["n_twins"]
    code, out, _ = tis(*words)
    assert f"{n_twins:,} twins, {n_twins:,} of them stored before" in out


def test_profiles_are_judged_and_the_cheapest_redundancy_is_found() -> None:
    words = (*QUICK, "--limit", "age_mean_ms=45", "--over", f"{DELAY}=0..100", "--checks", "4")
    code, out, err = tis(*words, "--profiles", "lossy.yaml,geo_satellite", "--max-copies", "3")
    assert code == 0, err
    report = kept()
    # The mean age is the delay and half a sample period or less, so the border is near the limit.
    assert 20 < report["estimators"]["hold"]["alone"][DELAY] <= 45
    lossy, satellite = report["profiles"]
    assert lossy["forward"]["loss_pct"] == pytest.approx(50)
    helped = lossy["redundancy"]["hold"]
    assert (helped["copies"], helped["history"]) in {(2, 0), (3, 0)}
    assert helped["packets_per_s"] > lossy["packets_per_s"] * (helped["copies"] - 0.2)
    assert satellite["redundancy"] == {"hold": None, "damped_velocity": None}
    assert not satellite["verdicts"]["hold"]["inside"]
    assert f"with {helped['text']}" in out
    assert Path("kept/admissible.pdf").is_file()


def test_a_figure_of_the_summary_is_a_limit_as_well(without_figure: None) -> None:
    words = (*QUICK, "--limit", "links.forward.loss_pct=30", "--over", f"{LOSS}=0..1", "--profiles", "none")
    code, _, err = tis(*words, "--checks", "0", "--estimators", "hold")
    assert code == 0, err
    assert 0.1 < kept()["estimators"]["hold"]["alone"][LOSS] < 0.32
    n_stored = len(list(Path("kept/cells").iterdir()))
    code, _, _ = tis(*words, "--checks", "0", "--estimators", "hold")
    assert (code, len(list(Path("kept/cells").iterdir()))) == (0, n_stored)
    code, _, err = tis(*QUICK, "--limit", "loss_pct=30", "--over", f"{LOSS}=0..1", "--profiles", "none")
    assert code == 2
    assert "--limit: must be one of the fast figures or a key of summary.json; did you mean" in err
    assert "links.forward.loss_pct" in err


def test_each_round_and_an_interrupt_tell_the_bracket_of_the_border(monkeypatch: pytest.MonkeyPatch) -> None:
    judge, n_rounds = Evaluation.judge, 0

    def interrupted(self: Evaluation, *about: Any) -> list[Judged]:
        nonlocal n_rounds
        n_rounds += 1
        if n_rounds == 4:
            raise KeyboardInterrupt
        return judge(self, *about)

    monkeypatch.setattr(Evaluation, "judge", interrupted)
    words = ("--limit", "age_mean_ms=45", "--over", f"{DELAY}=0..100", "--estimators", "hold", "--profiles", "none")
    code, _, err = tis(*QUICK, *words)
    assert code == 130
    assert f"2 networks decided: hold admissible up to {DELAY} = 0, no longer at 100" in err
    assert f"3 networks decided: hold admissible up to {DELAY} = 0, no longer at 50" in err
    assert re.search(r"no longer at 50; at most about \d+ (s|min) left in all", err)
    *_, last, _ = re.findall(r"(\d+ networks decided|interrupted): ", err)
    assert err.count("4 networks decided") == 2
    assert last == "4 networks decided"


def test_whole_numbers_and_a_bound_inside_the_range(without_figure: None) -> None:
    words = [*QUICK, "--limit", "age_mean_ms=70", "--set", f"{DELAY}=20", "--estimators", "hold", "--checks", "0"]
    words += ["--profiles", "none", "--points", "10"]
    code, _, err = tis(*words, "--over", "surgeon.copies=1..4", "--over", f"{LOSS}=0..2")
    assert code == 0, err
    assert "a part of the box counts as outside, as the scenario refuses it: --over:" in err
    assert "must be at most 1" in err
    report = kept()
    assert all(point["at"]["surgeon.copies"] in (1, 2, 3, 4) for point in report["points"])
    assert 0 < report["estimators"]["hold"]["share"] < 0.5
    assert all(at[LOSS] <= 1 for at in report["estimators"]["hold"]["border"])


def test_recorded_people_are_the_persons(written_people: Path, without_figure: None) -> None:
    words = [*QUICK, "--set", f"source={{kind: jigsaws, path: {written_people}, hands: [left]}}"]
    words += ["--set", "identification.train=own_head", "--limit", "age_mean_ms=60", "--over", f"{DELAY}=0..90"]
    code, out, err = tis(*words, "--profiles", "none", "--checks", "2")
    assert code == 0, err
    assert "over 2 synthetic people (S, T), 2 seeds for each trial" in out
    code, _, err = tis(*words, "--people", "S")
    assert code == 2
    assert "--people: must be of at least two people" in err
    assert "--trials takes those of others, too: T00" in err


def test_a_table_alone_is_refused_and_told_of_tables_with_its_columns() -> None:
    drawn = np.random.default_rng(1).normal(size=(400, 3)).cumsum(axis=0) / 1000
    rows = "\n".join(f"{k / 30:.4f},{x},{y},{z}" for k, (x, y, z) in enumerate(drawn))
    for name in ("ann_1.csv", "bob_1.csv"):
        Path(name).write_text(f"t,x,y,z\n{rows}\n")
    Path("rover.csv").write_text("stamp,volt\n1,2\n2,3\n")
    columns = "{time: t, left: {master: {position: [x, y, z]}}}"
    words = [*QUICK, "--set", f"source={{kind: table, path: ann_1.csv, columns: {columns}, hands: [left]}}"]
    code, _, err = tis(*words, "--limit", "age_mean_ms=60", "--over", f"{DELAY}=0..90", "--profiles", "none")
    assert code == 2
    assert "tis admissible: source: must be of at least two people" in err
    assert "--trials takes those of others, too: bob_1.csv; " in err
    [offered] = re.findall(r"errors of ann alone, network by network: tis (compare .*)", err)
    assert f"--sweep {DELAY}=0,22.5,45,67.5,90 " in offered
    code, out, err = call_in_one_line(*shlex.split(offered), "--jobs", "1", "--out", "compared")
    assert code == 0, err
    assert "nothing can be claimed about others" in out


@pytest.fixture
def written_people(tmp_path: Path) -> Path:
    from tis.deploy.tools.synth import write_trials

    _, second = write_trials(tmp_path / "jigsaws", 2, "Suturing", 1, 400 / 30, "a test")
    second.rename(second.with_name("Suturing_T002.txt"))
    return tmp_path / "jigsaws"


def test_mistakes_are_lines_and_leave_nothing() -> None:
    before = sorted(path.name for path in Path().iterdir())
    box = ("--over", f"{DELAY}=0..9")
    for words, lines in (
        ((), ["--limit: is required", "--over: is required"]),
        ((*box, "--limit", "rmse"), ["--limit: must read NAME=VALUE"]),
        ((*box, "--limit", "rmse_3d_mm=two"), ["--limit: must be a number"]),
        (("--limit", "rmse_3d_mm=2", "--over", f"{DELAY}=9..0"), ["--over: the range is empty or reversed"]),
        (("--limit", "rmse_3d_mm=2", "--over", "a.b=0..1"), ["--over: a.b: a: unknown key"]),
        (("--limit", "rmse_3d_mm=2", "--over", "seed=0..9"), ["--over: cannot be varied"]),
        (
            ("--limit", "rmse_3d_mm=2", "--over", "network.outages.0.down.high_s=1..2"),
            ["--set gives the network the stages"],
        ),
        ((*box, "--limit", "rmse_3d_mm=2", "--estimators", "fnord"), ["--estimators: no such estimator"]),
        (
            (*box, "--limit", "rmse_3d_mm=2", "--trials", "D001"),
            ["--trials: requires recordings: for a synthetic source use --seeds"],
        ),
        ((*box, "--limit", "rmse_3d_mm=2", "--seeds", "1"), ["--seeds: must be of at least two people"]),
        ((*box, "--limit", "rmse_3d_mm=2", "--profiles", "starlink"), ["--profiles: must be a profile"]),
        ((*box, "--limit", "x=y", "--over", "z", "--estimators", "fnord"), ["--limit", "--over", "--estimators"]),
    ):
        code, out, err = tis(*words)
        assert (code, out) == (2, ""), words
        for line in lines:
            assert line in err, words
        assert "tis compare" not in err
        assert "--sweep" not in err
    assert sorted(path.name for path in Path().iterdir()) == before
