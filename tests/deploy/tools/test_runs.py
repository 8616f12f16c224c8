"""Runs in a list: folders written by hand, with and without figures."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.deploy.commands import call


def _run(base: Path, name: str, written: str, rmse_mm: float | None = None, **more: Any) -> None:
    (base / name).mkdir(parents=True)
    (base / name / "scenario.yaml").write_text("name: any\n")
    if rmse_mm is None:
        return
    summary = {
        "scenario": "default",
        "mode": "twin",
        "valid": True,
        "active_estimator": "kf",
        "latency_ms": {"end_to_end": {"p50": 60.0, "p99": 70.0}},
        "links": {"forward": {"loss_pct": 1.0}},
        "accuracy": {"kf": {"rmse_3d_mm": rmse_mm, "ratio_to_hold": 0.5}},
    }
    (base / name / "summary.json").write_text(json.dumps(summary | more))
    (base / name / "manifest.json").write_text(json.dumps({"written": written}))


@pytest.fixture
def base(tmp_path: Path) -> Path:
    _run(tmp_path, "b", "2026-01-02T00:00:00+00:00", 0.5)
    _run(tmp_path, "sweep/a", "2026-01-01T00:00:00+00:00", 2.0, valid=False)
    _run(tmp_path, "c", "2026-01-03T00:00:00+00:00", 1.0, mode="live", scenario="lossy")
    _run(tmp_path, "aborted", "")
    (tmp_path / "no_run").mkdir()
    return tmp_path


def _listed(base: Path, *words: str) -> list[str]:
    code, out, _ = call("runs", str(base), "--json", *words)
    assert code == 0
    return [run["run_dir"] for run in json.loads(out)]


def test_runs_are_listed_in_the_order_they_were_written_and_aborted_ones_last(base: Path) -> None:
    assert _listed(base) == ["sweep/a", "b", "c", "aborted"]
    code, out, err = call("runs", str(base))
    assert code == 0
    assert [line.split()[0] for line in out.splitlines() if "twin" in line or "live" in line] == ["sweep/a", "b", "c"]
    assert "4 of 4 runs below" in " ".join(err.split())


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--sort", "rmse_3d_mm"), ["b", "c", "sweep/a", "aborted"]),
        (("--sort", "rmse_3d_mm", "--reverse"), ["sweep/a", "c", "b", "aborted"]),
        (("--sort", "error"), ["b", "c", "sweep/a", "aborted"]),
        (("--sort", "run"), ["aborted", "b", "c", "sweep/a"]),
        (("--valid",), ["b", "c"]),
        (("--invalid",), ["sweep/a"]),
        (("--mode", "live"), ["c"]),
        (("--scenario", "lossy", "--mode", "twin"), []),
    ],
)
def test_they_are_sorted_and_chosen(base: Path, words: tuple[str, ...], expected: list[str]) -> None:
    assert _listed(base, *words) == expected


def test_the_folder_of_a_netem_alone_is_listed_before_and_after_its_summary(base: Path) -> None:
    alone = base / "alone"
    alone.mkdir()
    (alone / "network.yaml").write_text("{}")
    assert "alone" not in _listed(base)  # a network without a log is no run
    (alone / "netem.mcap").touch()
    assert _listed(base, "--mode", "netem") == ["alone"]
    content = {"mode": "live", "valid": False, "links": {"forward": {"loss_pct": 2.5}}}
    (alone / "summary.json").write_text(json.dumps(content))
    (run,) = json.loads(call("runs", str(base), "--json", "--mode", "netem")[1])
    assert (run["mode"], run["valid"], run["loss_pct"], run["scenario"]) == ("netem", False, 2.5, None)


def test_figures_are_numbers_and_unknown_ones_null(base: Path) -> None:
    _, out, _ = call("runs", str(base), "--json")
    runs = {run["run_dir"]: run for run in json.loads(out)}
    assert runs["b"]["rmse_3d_mm"] == 0.5
    assert runs["b"]["end_to_end_p99_ms"] == 70.0
    assert set(runs["aborted"].values()) == {"aborted", None}


def test_a_summary_that_cannot_be_read_is_named_and_the_others_are_listed(base: Path) -> None:
    (base / "b" / "summary.json").write_text("{")
    code, out, err = call("runs", str(base), "--json")
    assert code == 0
    assert [run["run_dir"] for run in json.loads(out)] == ["sweep/a", "c", "aborted"]
    assert "b/summary.json: is not readable JSON" in "".join(err.split("\n"))


def test_a_column_or_a_folder_that_is_none_is_refused(base: Path) -> None:
    assert call("runs", str(base), "--sort", "speed")[0] == 2
    assert call("runs", str(base / "nowhere"))[0] == 4


def test_names_of_runs_stay_whole_in_a_narrow_terminal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    name = "20260102_000000_a_long_name_of_a_scenario"
    _run(tmp_path, name, "2026-01-02T00:00:00+00:00", 0.5)
    _, out, _ = call("runs", str(tmp_path))
    assert any(line.startswith(f"{name}  twin") for line in out.splitlines())


def test_where_nothing_is_chosen_it_says_what_there_is(base: Path) -> None:
    code, out, err = call("runs", str(base), "--scenario", "lsosy")
    assert (code, out) == (0, "")
    assert "0 of 4 runs below" in err
    assert err.strip().endswith("there are scenarios default, lossy; modes live, twin")


@pytest.mark.parametrize(
    "content", ['{"valid": [1], "links": 5}', '{"scenario": {}, "latency_ms": {"end_to_end": {"p50": "x"}}}']
)
def test_figures_of_no_kind_count_as_missing(tmp_path: Path, content: str) -> None:
    _run(tmp_path, "a", "")
    (tmp_path / "a" / "summary.json").write_text(content)
    code, out, _ = call("runs", str(tmp_path), "--json")
    assert code == 0
    assert {json.loads(out)[0][name] for name in ("valid", "scenario", "end_to_end_p50_ms", "loss_pct")} == {None}


@pytest.mark.parametrize("content", ["[" * 100_000, '{"a": NaN}', "{" + " " * 8_000_000 + "}"], ids=range(3))
def test_a_summary_too_large_or_too_deep_is_left_out(tmp_path: Path, content: str) -> None:
    _run(tmp_path, "a", "")
    (tmp_path / "a" / "summary.json").write_text(content)
    code, _, err = call("runs", str(tmp_path))
    assert code == 0
    assert "summary.json" in err
