"""Runs side by side: the page, and what each bad folder gets."""

import shutil
from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.deploy.commands import call_by_lines as tis
from tests.deploy.report.outline import Outline
from tis.deploy.present.numbers import number
from tis.deploy.report.compared import Difference, compared, in_number, in_percent, in_points
from tis.deploy.shell import run_dir as folder

LOSSY = ("--set", "network.forward.loss.p_loss=0.3", "--set", "network.forward.delay.delay_ms=90")
SETTINGS = (
    "estimators=[hold, damped_velocity]",
    "active_estimator=damped_velocity",
    "patient.orientation={methods: [hold], active: hold}",
)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with three twins: two alike but for the seed, and one with more delay and loss."""
    base = tmp_path_factory.mktemp("runs")
    for name, more in (("calm", ()), ("again", ("--seed", "8")), ("lossy", LOSSY)):
        words = ("--duration-s", "8", "--no-report", "--no-merge", "--run-dir", str(base / name), *more)
        assert tis("twin", "default", *(f"--set={setting}" for setting in SETTINGS), *words)[0] == 0
    return base


def _compared(runs: Path, out: Path, *names: str) -> Outline:
    code, lines, err = tis("report", "--compare", *(str(runs / name) for name in names), "--out", str(out))
    assert (code, lines, err) == (0, [f"Comparison: {out}"], [])
    return Outline(out.read_text())


@pytest.fixture(scope="module")
def lossy_and_calm(runs: Path, tmp_path_factory: pytest.TempPathFactory) -> Outline:
    """The page on these two runs."""
    return _compared(runs, tmp_path_factory.mktemp("page") / "page.html", "lossy", "calm")


def test_runs_stand_side_by_side_with_their_differences(runs: Path, tmp_path: Path) -> None:
    page = _compared(runs, tmp_path / "page.html", "calm", "again", "lossy")
    assert page.faults() == []
    assert all(target.startswith(("#", "data:")) for target in page.fetched)
    assert (tmp_path / "page.html").stat().st_size < 2_500_000
    for words in (
        "They differ in 3 fields", "network.forward.loss.p_loss", "0.01", "0.3", "seed",
        "Least median end-to-end latency, of estimates with a new sample: calm",
        "How the latency is distributed", "How the delays forward are distributed", "How the error is distributed",
        "Error against age", "Error over time", "Where the figures come from", str(runs / "lossy"),
    ):  # fmt: skip
        assert words in page.text, words
    names = [text for given, text in page.all("th") if given.get("scope") == "col"]
    assert names[:4] == ["figure", "calm", "again", "lossy"]
    toggles = {given["data-series"] for given, _ in page.all("button") if "data-series" in given}
    assert toggles == {"calm", "again", "lossy"}


def test_the_difference_is_that_to_the_first_run(runs: Path, tmp_path: Path, lossy_and_calm: Outline) -> None:
    shutil.copytree(runs / "calm", runs / "more" / "calm", dirs_exist_ok=True)  # a copy is another run
    same = _compared(runs, tmp_path / "same.html", "calm", "more/calm")
    assert "All runs have the same scenario and seed" in same.text
    assert "(same)" in same.text
    assert "+0 %" not in same.text
    assert "more/calm" in same.text
    rows = [text for _, text in lossy_and_calm.all("tr")]
    lossy, calm = (folder.read_json(runs / name / "summary.json") for name in ("lossy", "calm"))
    assert lossy is not None
    assert calm is not None
    first, second = (summary["links"]["forward"]["loss_pct"] for summary in (lossy, calm))
    expected = f"packets lost forward, %{number(first)}{number(second)} ({second - first:.1f} points)"
    assert expected in rows


@pytest.mark.parametrize(
    ("values", "difference", "beside"),
    [
        ((1.0, 1.2, 1.0), in_points, ["1.20 (+0.20 points)", "1.00 (same)"]),  # and not 20 %
        ((30.0, 1.0, 30.004), in_points, ["1.00 (-29.0 points)", "30.00 (±0 points)"]),
        ((0.0, 2.5), in_points, ["2.50 (+2.50 points)"]),
        ((40.0, 60.0, 40.1), in_percent, ["60.00 (+50 %)", "40.10 (±0 %)"]),
        ((0.0, 12.5), in_percent, ["12.50 (+12.5)"]),
        ((1, 5, 0), in_number, ["5 (+4)", "0 (-1)"]),
        ((None, 5.0), in_percent, ["5.00"]),
        ((5.0, None), in_points, ["-"]),
    ],
)
def test_shares_differin_points_countsin_numbers_and_all_else_in_per_cent(
    values: Sequence[float | None], difference: Difference, beside: list[str]
) -> None:
    assert compared(values, difference)[1:] == beside


def test_no_row_of_shares_has_a_difference_in_per_cent(lossy_and_calm: Outline) -> None:
    rows = [text for _, text in lossy_and_calm.all("tr")]
    shares = [row for row in rows if row.startswith(("packets lost ", "samples that never")) or "% of hold" in row]
    assert len(shares) == 4
    for row in shares:
        assert row.endswith((" points)", "(same)")), row


@pytest.fixture(scope="module")
def repetitions(runs: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int, list[str]]:
    """The directory in which two repetitions were compared, the exit code, and what was printed."""
    current = tmp_path_factory.mktemp("current")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(current)
        code, out, _ = tis("report", "--compare", str(runs / "calm"), str(runs / "again"))
    return current, code, out


def test_without_a_name_the_page_lies_in_the_current_directory_and_that_is_said(
    repetitions: tuple[Path, int, list[str]],
) -> None:
    current, code, out = repetitions
    assert (code, out) == (0, [f"Comparison: {current / 'compare.html'}"])
    assert (current / "compare.html").is_file()


def test_repetitions_are_called_so(repetitions: tuple[Path, int, list[str]]) -> None:
    assert "they are repetitions" in Outline((repetitions[0] / "compare.html").read_text()).text


@pytest.mark.parametrize("n", [1, 9])
def test_too_few_and_too_many_are_refused(runs: Path, n: int) -> None:
    code, out, err = tis("report", "--compare", *(str(runs / f"run_{i}") for i in range(n)))
    assert (code, out) == (2, [])
    assert err == [f"tis: tis report: --compare: needs 2 to 8 runs (got {n})"]


def test_each_bad_folder_gets_a_line(runs: Path, tmp_path: Path) -> None:
    """No run at all, a run without logs, and one whose summary is broken; nothing is written."""
    (tmp_path / "nothing").mkdir()
    empty, broken = Path(shutil.copytree(runs / "calm", tmp_path / "empty")), tmp_path / "broken"
    for log in empty.glob("*.mcap"):
        log.unlink()
    (empty / "summary.json").unlink()
    shutil.copytree(runs / "calm", broken)
    (broken / "summary.json").write_text("{")
    folders = [str(runs / "calm"), str(tmp_path / "nothing"), str(empty), str(broken)]
    code, out, err = tis("report", "--compare", *folders, "--out", str(tmp_path / "page.html"))
    assert (code, out) == (4, [])
    assert len(err) == 3
    assert "nothing: is no run folder" in err[0]
    assert "empty: holds no message" in err[1]
    assert "is not readable JSON" in err[2]
    assert not (tmp_path / "page.html").exists()


def test_a_run_with_a_truncated_log_is_compared_as_far_as_it_goes(runs: Path, tmp_path: Path) -> None:
    cut = Path(shutil.copytree(runs / "calm", tmp_path / "cut"))
    (cut / "summary.json").unlink()
    data = (cut / "patient.mcap").read_bytes()
    (cut / "patient.mcap").write_bytes(data[: len(data) // 2])
    page = tmp_path / "page.html"
    code, _, err = tis("report", "--compare", str(runs / "calm"), str(cut), "-o", str(page))
    assert (code, err) == (3, [])
    assert "cut: not a valid measurement" in Outline(page.read_text()).text


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        (["a", "b"], "tis: tis report: RUN_DIR: must be a single run unless --compare is given (got 2)"),
        (
            ["a", "--out", "x"],
            "tis: tis report: --out: requires --compare; the report of a single run lies in its folder (got 'x')",
        ),
        (["a", "--format", "svg"], "tis: tis report: --format: requires --figures (got 'svg')"),
        (
            ["a", "b", "--compare", "--figures", "x"],
            "tis: tis report: --figures: draws a single run and excludes --compare",
        ),
    ],
)
def test_options_that_do_not_go_together_are_refused(words: list[str], fault: str) -> None:
    assert tis("report", *words) == (2, [], [fault])


def test_the_same_run_twice_is_refused_however_it_is_spelled(runs: Path, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(runs / "calm")
    code, out, err = tis("report", "--compare", str(runs / "calm"), str(tmp_path / "link"), "-o", "page.txt")
    assert (code, out) == (2, [])
    assert err == [
        f"tis: tis report: --compare: must be different runs, this one is given twice (got '{tmp_path / 'link'}')",
        "tis: tis report: --out: must end in .html (got 'page.txt')",
    ]


def test_a_page_that_is_there_is_replaced_and_that_is_said(runs: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text("old")
    code, out, _ = tis("report", "--compare", str(runs / "calm"), str(runs / "again"), "-o", str(page))
    assert (code, out) == (0, [f"Comparison: {page} (replaced)"])
    assert page.read_text() != "old"
