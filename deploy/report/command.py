"""`tis report`: pages and figures of run folders, of one run or of several."""

import shutil
from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rich.console import Console
from rich.markup import escape

from tis.common.errors import EXIT_LOSSY_RECOVERY, EXIT_OK, DataError, Fault, InputError, TisError
from tis.common.extras import GET_REPORT
from tis.deploy.logs.read.load import load_run, mode_of, models_in, scenario_in
from tis.deploy.present.palette import SERIES
from tis.deploy.report.measured_run import MeasuredRun
from tis.deploy.report.run_view import RunView
from tis.deploy.report.summarise import summary_of
from tis.deploy.report.summary import readable, summary_in
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.guard import can_report

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COMPARED_FILE: Final = Path("compare.html")
_PAGES: Final = (".html", ".htm")
MAX_COMPARED: Final = len(SERIES)


def report_again(run_dir: Path, out: Console) -> int:
    """Write the report of a run folder; return `EXIT_LOSSY_RECOVERY` when a log is missing or damaged, else 0.

    Raises `InputError` without Bokeh, `DataError` when the folder is no run or its summary cannot be read.
    """
    _need_bokeh()
    run = read_run(run_dir)
    if not run.logs.sides:
        raise DataError(Fault(str(run_dir), "", "holds no log, so there is nothing to report"))
    with readable(run_dir / folder.SUMMARY_FILE):
        line = write_report(run)
    out.print(escape(line), soft_wrap=True)
    return _print_problems(run.logs.problems(), out)


def write_report(run: RunView) -> str:
    """Write the report; return a line with its path, or with the command that installs Bokeh."""
    if not can_report():
        return f"No report was written, since Bokeh is not installed: {GET_REPORT}"
    # imported late, as Bokeh loads slowly
    from tis.deploy.report.contents import report_html

    path = run.logs.run_dir / folder.REPORT_FILE
    folder.write(path, report_html(run))
    return f"Report: {path}"


def compare_runs(run_dirs: Sequence[Path], page: Path | None, out: Console) -> int:
    """Write a page that compares runs, by default ``compare.html`` in the current folder; it may replace a page.

    Returns `EXIT_LOSSY_RECOVERY` when a log is missing or damaged, else 0. Raises `InputError` for too few or too
    many runs, for a duplicate, and for a name without the suffix of a page; `DataError` with a fault for each folder
    that is no run or is empty.
    """
    _need_bokeh()
    path = page or COMPARED_FILE
    _check_comparison(run_dirs, path)
    faults: list[Fault] = []
    runs: dict[str, RunView] = {}
    # all folders are read before the first fault is raised
    for name, run_dir in zip(_names(run_dirs), run_dirs, strict=True):
        try:
            run = read_run(run_dir)
        except TisError as error:
            faults += error.faults
            continue
        if not any(log.n_messages for log in run.logs.sides.values()):
            faults.append(Fault(str(run_dir), "", "holds no message, so there is nothing to compare"))
        runs[name] = run
    if faults:
        raise DataError(faults)
    # imported late, as Bokeh loads slowly
    from tis.deploy.report.compared import compared_html

    replaced = " (replaced)" if path.exists() else ""
    with readable(path):
        folder.write(path, compared_html(runs))
    out.print(escape(f"Comparison: {path.resolve()}{replaced}"), soft_wrap=True)
    problems = [f"{name}: {text}" for name, run in runs.items() for text in run.logs.problems()]
    return _print_problems(problems, out)


def _print_problems(problems: Sequence[str], out: Console) -> int:
    for problem in problems:
        out.print(escape(f"  not valid: {problem}"), style="red", soft_wrap=True)
    return EXIT_LOSSY_RECOVERY if problems else EXIT_OK


def draw_figures(run_dir: Path, into: Path, file_format: str, out: Console) -> int:
    """Write a run's figures for papers into a folder, which is created if needed.

    Raises as `write_figures` does, and `DataError` as `report_again` does.
    """

    def draw() -> tuple[dict[str, "Figure"], Sequence[str]]:
        from tis.deploy.report.publication.run_figures import paper_figures

        run = read_run(run_dir)
        with readable(run_dir / folder.SUMMARY_FILE):
            return paper_figures(run), run.logs.problems()

    return write_figures(run_dir, draw, into, file_format, out)


def write_figures(
    run_dir: Path,
    draw: Callable[[], tuple[Mapping[str, "Figure"], Sequence[str]]],
    into: Path,
    file_format: str,
    out: Console,
) -> int:
    """Write the figures that ``draw`` returns, with the problems of the logs, into a folder, created if needed.

    Raises `InputError` for an unknown format or without matplotlib, `DataError` without a figure.
    """
    if find_spec("matplotlib") is None:
        raise InputError(Fault("tis report", "--figures", f"needs matplotlib: {GET_REPORT}"))
    from tis.deploy.report.publication.matplotlib_figures import FORMATS, rendered

    if file_format not in FORMATS:
        raise InputError(Fault("tis report", "--format", f"must be one of {', '.join(FORMATS)}", file_format))
    figures, problems = draw()
    drawn = {f"{name}.{file_format}": rendered(figure, file_format) for name, figure in figures.items()}
    if not drawn:
        raise DataError(Fault(str(run_dir), "", "its logs hold nothing to draw"))
    # a folder made here is removed again when a figure cannot be written
    is_new = not into.exists()
    try:
        into.mkdir(parents=True, exist_ok=True)
        for name, content in drawn.items():
            folder.write(into / name, content)
    except OSError as error:
        raise DataError(Fault(str(into), "", f"folder cannot be created: {error.strerror}")) from None
    except DataError:
        if is_new:
            shutil.rmtree(into, ignore_errors=True)
        raise
    out.print(escape(f"{len(drawn)} figures in {into}: {', '.join(drawn)}"), soft_wrap=True)
    return _print_problems(problems, out)


def read_run(run_dir: Path) -> RunView:
    """Return the view of a run folder.

    A missing summary, or one that is older than a log's damage, is computed from the logs. Raises `DataError` when
    the folder is no run or its summary is of another version.
    """
    logs = load_run(run_dir)
    scenario = folder.read_scenario(run_dir, scenario_in(logs))
    run = MeasuredRun.of(logs, scenario, models_in(logs))
    before = folder.read_json(run_dir / folder.SUMMARY_FILE)
    if before is None or not set(logs.problems()) <= set(folder.texts_in(before.get("problems"))):
        # logs were lost or damaged since: the figures would describe data that no longer exist
        about = before or {}
        summary = summary_of(run, mode_of(logs), about.get("exit"), about.get("command", ""))
    else:
        summary = summary_in(before, run_dir / folder.SUMMARY_FILE)
    manifest = folder.read_json(run_dir / folder.MANIFEST_FILE) or {}
    return RunView.of(run, summary, manifest)


def _check_comparison(run_dirs: Sequence[Path], page: Path) -> None:
    """Raise `InputError` with all faults of the request."""
    where, faults = "tis report", []
    if not 2 <= len(run_dirs) <= MAX_COMPARED:
        faults.append(Fault(where, "--compare", f"needs 2 to {MAX_COMPARED} runs", len(run_dirs)))
    real = [path.resolve() for path in run_dirs]
    for i, path in enumerate(run_dirs):
        if real.index(real[i]) < i:
            faults.append(Fault(where, "--compare", "must be different runs, this one is given twice", str(path)))
    if page.suffix not in _PAGES:
        faults.append(Fault(where, "--out", f"must end in {_PAGES[0]}", str(page)))
    if faults:
        raise InputError(faults)


def _names(run_dirs: Sequence[Path]) -> list[str]:
    """Return a short name for each run: its folder's, with as many parents as needed to be unique."""
    paths = [path.resolve() for path in run_dirs]
    for depth in range(1, max(len(path.parts) for path in paths) + 1):
        names = ["/".join(path.parts[-depth:]) for path in paths]
        if len(set(names)) == len(names):
            return names
    raise AssertionError("paths that differ have names that differ")


def _need_bokeh() -> None:
    if not can_report():
        raise InputError(Fault("tis report", "", f"needs Bokeh: {GET_REPORT}"))
