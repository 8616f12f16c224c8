"""The command from beginning to end, on a small population of another seed: rows, and what fails by name."""

import json
import re
import sys
from pathlib import Path

import pytest

from tests.deploy.commands import call_in_one_line as tis
from tests.deploy.studies.score.test_foreign import HOLD
from tis.deploy.studies.score import foreign, plan, population
from tis.deploy.studies.score.protocol import content

OWN = """
from tis.patient_side.estimators.protocol import Estimate

class Mine:
    def __init__(self, model): pass
    def initial(self): return None
    def step(self, state, playout, now_ns):
        return state, Estimate(playout.arm.get(playout.arm.newest))

class Broken(Mine):
    def step(self, state, playout, now_ns): raise ValueError("no idea")
"""


@pytest.fixture
def small(own_folder: Path, monkeypatch: pytest.MonkeyPatch, in_this_process: None) -> Path:
    """A protocol of one short setting, of few people."""
    quick, its = content()["quick"], content()["tracks"]["open"]
    monkeypatch.setitem(quick, "people", 2)
    monkeypatch.setitem(quick, "duration_s", 4)
    monkeypatch.setitem(quick, "settings", ["100 ms"])
    monkeypatch.setitem(its, "trained", {"people": 2, "duration_s": 12})
    monkeypatch.setitem(its, "scored", {"people": 2, "duration_s": 6})
    monkeypatch.setattr(population, "hashes", dict)
    plan._tables.cache_clear()
    (own_folder / "own_score.py").write_text(OWN, "utf-8")
    return own_folder


def _row(folder: Path, name: str, seed: int = 5) -> dict[str, object]:
    found: dict[str, object] = json.loads(
        (folder / "runs" / "score" / f"open_quick_seed_{seed}" / f"{name}.json").read_text("utf-8")
    )
    return found


def test_shipped_own_and_foreign_estimators_have_rows_that_are_equal_when_repeated(small: Path) -> None:
    (small / "hold.py").write_text(HOLD, "utf-8")
    command = f"{sys.executable} hold.py"
    code, out, err = tis("score", "hold", "own_score:Mine", command, "--quick", "--seed", "5", "--jobs", "1")
    assert code == 0, err
    assert "score: error over hold's" in out
    rows = [_row(small, name) for name in ("hold", "own_score_Mine", "_".join(re.findall(r"\w+", command)))]
    for row in rows:
        assert (row["score"], row["score_interval_95"], row["n_missing"]) == (1.0, [1.0, 1.0], 0)
        assert list(row["settings"]) == ["100 ms"]  # type: ignore[call-overload]
        assert row["machine"]["step_ratio"] > 0  # type: ignore[index]
    assert [row["machine"]["timed_by"] for row in rows] == ["processor time", "processor time", "the clock"]  # type: ignore[index]
    code, _, err = tis("score", "damped_velocity", "--quick", "--seed", "5", "--jobs", "1")
    first = _row(small, "damped_velocity")
    assert tis("score", "damped_velocity", "--quick", "--seed", "5", "--jobs", "1")[0] == code == 0
    again = _row(small, "damped_velocity")
    assert {**first, "machine": None} == {**again, "machine": None}
    assert 0.2 < first["score"] < 0.95  # type: ignore[operator]


def test_the_ranking_under_two_seeds_resumes_and_is_that_of_their_rows(small: Path) -> None:
    words = ("score", "hold", "damped_velocity", "--quick", "--jobs", "1")
    code, out, err = tis(*words, "--seeds", "2")
    assert (code, "2 of 2 seeds (1 to 2, of the quick sample)" in out) == (0, True), err
    file = small / "runs" / "score" / "stability_open_quick.json"
    text = file.read_text("utf-8")
    assert tis(*words, "--seed", "2")[0] == 0
    own = json.loads(text)["scores"]
    assert [own[name][1] for name in ("hold", "damped_velocity")] == [1.0, _row(small, "damped_velocity", 2)["score"]]
    assert tis(*words, "--seeds", "2")[0] == 0
    assert file.read_text("utf-8") == text


@pytest.mark.parametrize(
    ("name", "why"),
    [("own_score:Broken", "no idea"), (f"{sys.executable} -c 'raise SystemExit(3)'", "ended with exit code 3")],
)
def test_an_estimator_that_fails_is_a_failed_row_by_its_name(small: Path, name: str, why: str) -> None:
    foreign._FAILED.clear()
    code, _, err = tis("score", name, "--quick", "--seed", "5", "--jobs", "1")
    assert (code, f"{name}: failed" in err, why in err) == (5, True, True)


def test_what_cannot_be_scored_is_refused_before_anything_is_computed(own_folder: Path) -> None:
    assert tis("score", "no_such_estimator", "--quick")[0] == 2
    code, _, err = tis("score", "hold", "--quick", "--path", "x")
    assert (code, "must be given with --track jigsaws" in err) == (2, True)
    for given in (("hold",), ("hold", "arx_kf", "--seed", "2")):
        code, _, err = tis("score", *given, "--seeds", "2")
        assert (code, "--seeds: must be given without --seed, for two" in err) == (2, True)
    code, _, err = tis("score", "hold", "--track", "jigsaws", "--path", "nowhere")
    assert (code, "JIGSAWS is to be had for research on request" in err) == (4, True)
    assert not (own_folder / "runs").exists()
