"""A run with an estimator of the user's own, the documented one: twin, summary, replay, and what shows it."""

import json
import re
import shlex
from pathlib import Path

import pytest
from mcap.reader import make_reader
from typer.testing import CliRunner

from tests.deploy.report.partial import causes
from tests.documented_estimator import DOCUMENT, FILE, NAME, documented_commands, documented_estimator
from tis.deploy.cli.main import app
from tis.deploy.report.run_data import load
from tis.deploy.run.replay import replay

FAILING = """
from my_filter import AlphaBeta

class Filter(AlphaBeta):
    def step(self, state, playout, now_ns):
        if now_ns > 3_000_000_000 and playout.arm.newest % 3 == 0:
            raise RuntimeError("index divisible")
        return super().step(state, playout, now_ns)
"""
FAILING_NAME = "a_rather_long_name_of_a_package.filters:Filter"


def tis(*words: str) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, list(words))
    assert "Traceback" not in result.output, result.output
    return result.exit_code, result.stdout, result.stderr


@pytest.fixture
def there(own_folder: Path) -> Path:
    """Return the current folder, in which the documented estimator lies, and one that fails at times."""
    (own_folder / FILE).write_text(documented_estimator())
    package = own_folder / "a_rather_long_name_of_a_package"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "filters.py").write_text(FAILING)
    return own_folder


def twin(*names: str, active: str = NAME, duration_s: int = 6, more: tuple[str, ...] = ()) -> tuple[int, str, str]:
    """Call `tis twin` with models for all estimators, from few rows and in each call the same."""
    listed = ", ".join(("hold", "innovations_kf", *names))
    return tis("twin", "default", "--duration-s", str(duration_s), "--set", f"estimators=[{listed}]",
               "--set", f"active_estimator={active}", "--set", "identification.train_samples=300",
               "--run-dir", "run", "-v", *more)  # fmt: skip


def test_the_document_is_short_and_its_example_too() -> None:
    assert len(DOCUMENT.read_text().splitlines()) < 150
    lines = [line for line in documented_estimator().splitlines() if line.strip()]
    assert 25 <= len(lines) <= 40
    for command in documented_commands():
        (listed,) = (word for word in shlex.split(command) if "hold, " in word or "hold," in word)
        assert NAME in listed


def test_a_run_with_the_documented_estimator_is_whole(there: Path) -> None:
    code, out, err = twin(NAME, FAILING_NAME)
    assert code == 0, err
    assert FAILING_NAME.split(":")[0] in out  # whole, as no terminal reads it

    summary = json.loads(Path("run/summary.json").read_text())
    assert summary["valid"]
    accuracy = summary["accuracy"]
    assert accuracy[NAME]["ratio_to_hold"] < 0.85
    assert accuracy[NAME]["n_missing"] == 0
    assert accuracy[FAILING_NAME]["n_missing"] > 0
    assert (accuracy[NAME]["failed"], accuracy[FAILING_NAME]["failed"]) == (False, True)
    assert "failed" not in accuracy["hold"]
    own = summary["own_estimators"]
    assert own[NAME]["first_fault"] is None
    assert own[NAME]["faulty_steps"] == 0
    first = own[FAILING_NAME]["first_fault"]
    assert (first["hand"], first["reason"]) == ("left", "RuntimeError: index divisible (filters.py, line 7)")
    assert 3.0 < first["at_s"] < 3.2
    flat = " ".join(out.split())
    assert f"warning: * {FAILING_NAME} failed in {own[FAILING_NAME]['faulty_steps']} steps: no estimate there" in flat
    assert f"* {NAME}" not in flat

    manifest = json.loads(Path("run/manifest.json").read_text())["own_estimators"]
    assert manifest[NAME]["file"] == FILE
    assert re.fullmatch("[0-9a-f]{64}", manifest[NAME]["sha256"])
    assert manifest[FAILING_NAME]["file"] == "a_rather_long_name_of_a_package/filters.py"
    assert str(there) not in json.dumps(manifest)
    assert str(there) not in Path("run/scenario.yaml").read_text()
    page = Path("run/report.html").read_text()
    assert "a_rather_long_name_of_a_package.filters:<wbr>Filter *" in page
    assert "RuntimeError: index divisible" in page

    plain = ["my_filter__AlphaBeta", "a_rather_long_name_of_a_package_filters__Filter"]
    with Path("run/run.mcap").open("rb") as file:
        found = make_reader(file).get_summary()
    assert found is not None
    topics = {channel.topic for channel in found.channels.values()}
    assert {f"{kind}/{name}" for kind in ("/estimates", "/paths", "/metrics/error") for name in plain} <= topics
    assert all(re.fullmatch("[A-Za-z0-9_/]+", topic) for topic in topics)
    run = load(Path("run"))
    assert set(run.tracks["left"].estimates) == {"hold", "innovations_kf", NAME, FAILING_NAME}
    assert len(run.error_mm(NAME)) == 180


def test_a_replay_meets_the_run_and_says_what_has_changed_since(there: Path) -> None:
    code, _, err = twin(NAME, duration_s=4, more=("--no-report", "--no-merge"))
    assert code == 0, err
    assert replay(Path("run")).identical
    (there / FILE).write_text(documented_estimator().replace("0.8, 0.5,", "0.7, 0.5,"))
    assert len(replay(Path("run")).changed) == 1  # what this process has loaded is still the old one
    code, _, err = tis("replay", "run")
    assert code == 0
    assert "warning: my_filter:AlphaBeta: my_filter.py has changed since the run" in err.replace("\n", " ")
    code, _, err = tis("export", "run", "--csv", "--out", "exported")
    assert code == 0, err
    head = Path("exported/tracks.csv").read_text().splitlines()[0].split(",")
    assert {"my_filter__AlphaBeta_x_m", "my_filter__AlphaBeta_error_mm"} <= set(head)
    assert all(re.fullmatch("[A-Za-z0-9_]+", column) for column in head)
    assert NAME in Path("exported/estimates.csv").read_text()


@pytest.mark.parametrize("command", ["twin", "run"])
def test_what_cannot_be_imported_is_refused_before_anything_is_made(own_folder: Path, command: str) -> None:
    names = "[hold, nope_own:F, 'my_filter:X']"
    code, out, err = tis(command, "default", "--set", f"estimators={names}", "--set", "active_estimator=hold")
    assert (code, out) == (2, "")
    assert err.splitlines() == [
        f"tis: estimators: {name}: no module {name.partition(':')[0]!r}, neither in the current folder nor on "
        "Python's search path"
        for name in ("nope_own:F", "my_filter:X")
    ]
    assert list(own_folder.iterdir()) == []


def test_a_factory_that_gives_none_is_refused_before_anything_is_made(own_folder: Path) -> None:
    (own_folder / "refusing_own.py").write_text("def F(model): raise ValueError(f'not of {model.arm}')\n")
    code, out, err = twin("refusing_own:F", active="hold")
    assert (code, out) == (2, "")
    rule = "raised ValueError: not of PSM2 (refusing_own.py, line 1), when it was given the model"
    assert err.splitlines() == [f"tis: estimators: refusing_own:F: {rule}"]
    assert not (own_folder / "run").exists()


def test_a_patient_alone_refuses_what_it_cannot_find_and_the_others_do_not_ask(own_folder: Path) -> None:
    Path("s.yaml").write_text(
        "version: 1\nname: s\nsource: {kind: synthetic}\nestimators: [hold, nope_own:F]\nactive_estimator: hold\n"
        "hosts: {west: tcp/127.0.0.1:1, east: tcp/127.0.0.1:1}\n"
    )
    nowhere = "neither in the current folder nor on Python's search path"
    code, _, err = tis("patient", "s.yaml", "--run-dir", "run")
    assert code == 2
    assert err.splitlines() == [f"patient: estimators: nope_own:F: no module 'nope_own', {nowhere}"]
    assert not (own_folder / "run").exists()
    code, _, err = tis("surgeon", "s.yaml", "--run-dir", "run", "--wait-s", "0")
    assert code == 3  # there is no netem; but nothing is wrong with the scenario
    assert "nope_own" not in err


def test_validating_a_scenario_imports_nothing(own_folder: Path) -> None:
    (own_folder / "loud_own.py").write_text("open('was_run', 'w')\n")
    settings = ("--set", "estimators=[hold, loud_own:F]", "--set", "active_estimator=hold")
    code, out, _ = tis("validate", "default", *settings)
    assert code == 0
    assert "- loud_own:F" in out
    assert not (own_folder / "was_run").exists()


USELESS = """
import numpy as np
from tis.patient_side.estimators.protocol import Estimate

class Useless:
    def __init__(self, model):
        pass

    def initial(self):
        return None

    def step(self, state, playout, now_ns):
        {what}
"""


@pytest.mark.parametrize(
    ("what", "reason"),
    [
        ("raise RuntimeError('no')", "RuntimeError: no (useless.py, line 13)"),
        ("np.zeros((2, 2)) @ np.zeros(3)", "ValueError: matmul"),
        (
            "return None, Estimate(np.full(3, np.nan))",
            "position_m must be finite (got nan nan nan) (useless.py, line 12)",
        ),
        (
            "return None, Estimate(np.full(3, 1e300))",
            "position_m must lie within 1e+09 m (got 1e+300) (useless.py, line 12)",
        ),
        ("return None, Estimate(None)", None),
    ],
)
def test_an_active_estimator_without_estimates_makes_a_run_invalid(
    own_folder: Path, what: str, reason: str | None
) -> None:
    (own_folder / "useless.py").write_text(USELESS.format(what=what))
    code, out, err = twin("useless:Useless", active="useless:Useless", more=("--no-merge", "--no-report"))
    assert code == 5, err
    assert "This run is not a valid measurement" in out
    summary = json.loads(Path("run/summary.json").read_text())
    n_scored = summary["accuracy"]["useless:Useless"]["n_scored"]
    assert n_scored > 100
    first = summary["own_estimators"]["useless:Useless"]["first_fault"]
    if reason is None:
        assert first is None
        rule = f"gave no estimate at {n_scored} of {n_scored} scored ticks, where hold's is scored"
    else:
        assert first["reason"].startswith(reason)
        assert "useless:Useless failed: no estimate at any scored tick; hold " in " ".join(out.split())
        rule = f"failed at every scored tick, and has no score: {first['reason']}"
    assert causes(summary["problems"]) == [f"accuracy: useless:Useless {rule}"]


def test_an_estimator_that_always_fails_has_no_score_and_makes_a_run_invalid(own_folder: Path) -> None:
    (own_folder / "useless.py").write_text(USELESS.format(what="raise RuntimeError('no')"))
    code, out, err = twin("useless:Useless", active="innovations_kf", more=("--no-merge",))
    assert code == 5, err
    assert "RuntimeError: no (useless.py, line 13)" in " ".join(out.split())
    assert "not known" not in out
    score = json.loads(Path("run/summary.json").read_text())["accuracy"]["useless:Useless"]
    assert (score["failed"], score["rmse_3d_mm"], score["ratio_to_hold"], score["r2_pct"]) == (
        True,
        None,
        None,
        3 * [None],
    )
    assert "useless:<wbr>Useless failed" in Path("run/report.html").read_text()


@pytest.mark.parametrize("where_m", ["1e8", "-1e9"])
def test_an_absurd_estimate_is_scored_and_breaks_no_summary(own_folder: Path, where_m: str) -> None:
    step = f"return None, Estimate(np.full(3, {where_m}), np.full((3, 3), 1e300))"
    (own_folder / "useless.py").write_text(USELESS.format(what=step))
    code, _, err = twin("useless:Useless", active="useless:Useless", duration_s=4)
    assert code == 0, err
    summary = json.loads(Path("run/summary.json").read_text())
    score = summary["accuracy"]["useless:Useless"]
    assert score["n_missing"] == 0
    assert score["rmse_3d_mm"] == pytest.approx(3**0.5 * abs(float(where_m)) * 1e3)
    assert Path("run/report.html").stat().st_size > 100_000
