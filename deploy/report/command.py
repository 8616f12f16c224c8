"""`tis report`: run folders to pages and figures, alone, side by side, and for papers."""

import shutil
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.markup import escape

from common.errors import EXIT_LOSSY_RECOVERY, EXIT_OK, DataError, Fault, InputError, TisError
from common.scenario import Scenario
from deploy.logs.read.load import RunLogs, load_run
from deploy.logs.read.recorded import mode_of, models_in, scenario_in
from deploy.report.palette import SERIES
from deploy.report.run_view import RunView, run_view
from deploy.report.summary import build_summary
from deploy.report.summary_version import check_version
from deploy.shell import run_dir as folder
from deploy.shell.extras import GET_REPORT, can_report
from patient_side.statespace import ArmModel

COMPARED_FILE: Final = Path("compare.html")
_PAGES: Final = (".html", ".htm")
MAX_COMPARED: Final = len(SERIES)


def report_again(run_dir: Path, out: Console) -> int:
    """Write the report of a run folder, whatever is left in it; 0, or `EXIT_LOSSY_RECOVERY` when that is not all.

    Raises `InputError` without Bokeh, `DataError` when the folder is no run or its summary cannot be read.
    """
    _need_bokeh()
    run = read_run(run_dir)
    if not run.logs.sides:
        raise DataError(Fault(str(run_dir), "", "holds no log, so there is nothing to report"))
    manifest = folder.read_json(run_dir / folder.MANIFEST_FILE) or {}
    line = write_report(run.logs, run.scenario, run.models, run.summary, manifest)
    out.print(escape(line), soft_wrap=True)
    return _say_what_is_lacking(run.logs.problems(), out)


def write_report(
    logs: RunLogs,
    scenario: Scenario,
    models: Sequence[ArmModel],
    summary: dict[str, Any],
    manifest: Mapping[str, Any],
) -> str:
    """Write the report; return a line that names it, or that says how to get one."""
    if not can_report():
        return f"No report was written, since Bokeh is not installed: {GET_REPORT}"
    # Bokeh takes a while to load, so only now
    from deploy.report.page.html import report_html

    path = logs.run_dir / folder.REPORT_FILE
    folder.write(path, report_html(run_view(logs, scenario, models, summary, manifest)))
    return f"Report: {path}"


def compare_runs(run_dirs: Sequence[Path], page: Path | None, out: Console) -> int:
    """Write a page with two or more runs side by side: ``compare.html``, here, when no name is given.

    Returns 0, or `EXIT_LOSSY_RECOVERY` when a log is missing or damaged.

    A page that is there already is replaced, as every page that can be computed again, and that is said.
    Raises `InputError` for too few or too many, for a folder that comes twice and a name that is no page's,
    `DataError` with a fault for each folder that is no run, or an empty one.
    """
    _need_bokeh()
    path = page or COMPARED_FILE
    _check_comparison(run_dirs, path)
    faults: list[Fault] = []
    runs: dict[str, RunView] = {}
    for name, run_dir in zip(_names(run_dirs), run_dirs, strict=True):
        try:
            run = read_run(run_dir)
        except TisError as error:
            faults += error.faults
            continue
        if not any(log.n_messages for log in run.logs.sides.values()):
            faults.append(Fault(str(run_dir), "", "holds no log with anything in it, so there is nothing to compare"))
        runs[name] = run
    if faults:
        raise DataError(faults)
    # Bokeh takes a while to load, so only now
    from deploy.report.compared.compared_html import compared_html

    replaced = " (replaced)" if path.exists() else ""
    folder.write(path, compared_html(runs))
    out.print(escape(f"Comparison: {path.resolve()}{replaced}"), soft_wrap=True)
    problems = [f"{name}: {text}" for name, run in runs.items() for text in run.logs.problems()]
    return _say_what_is_lacking(problems, out)


def _say_what_is_lacking(problems: Sequence[str], out: Console) -> int:
    for problem in problems:
        out.print(escape(f"  not valid: {problem}"), style="red", soft_wrap=True)
    return EXIT_LOSSY_RECOVERY if problems else EXIT_OK


def draw_figures(run_dir: Path, into: Path, file_format: str, out: Console) -> int:
    """Write a run's figures for papers into a folder, made when there is none.

    Raises `InputError` for an unknown format or without matplotlib, `DataError` as `report_again` does.
    """
    if find_spec("matplotlib") is None:
        raise InputError(Fault("tis report", "--figures", f"needs matplotlib: {GET_REPORT}"))
    from deploy.report.publication.run_figures import FORMATS, paper_figures, rendered

    if file_format not in FORMATS:
        raise InputError(Fault("tis report", "--format", f"must be one of {', '.join(FORMATS)}", file_format))
    run = read_run(run_dir)
    drawn = {f"{name}.{file_format}": rendered(figure, file_format) for name, figure in paper_figures(run).items()}
    if not drawn:
        raise DataError(Fault(str(run_dir), "", "its logs hold nothing to draw"))
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
    return _say_what_is_lacking(run.logs.problems(), out)


def read_run(run_dir: Path) -> RunView:
    """Return what a run folder holds, as reports see it.

    A summary that is not there, or that is older than a log's damage, is made from the logs.
    Raises `DataError` when the folder is no run or its summary is none of this version.
    """
    logs = load_run(run_dir)
    scenario = folder.read_scenario(run_dir, scenario_in(logs))
    models = models_in(logs)
    summary = folder.read_json(run_dir / folder.SUMMARY_FILE)
    if summary is None or not set(logs.problems()) <= set(summary.get("problems", ())):
        # logs that were lost or damaged since: the summary would tell of a run that nobody can look at any longer
        before = summary or {}
        summary = build_summary(logs, scenario, models, mode_of(logs), before.get("exit"), before.get("command", ""))
    else:
        check_version(summary, run_dir / folder.SUMMARY_FILE, scenario)
    manifest = folder.read_json(run_dir / folder.MANIFEST_FILE) or {}
    return run_view(logs, scenario, models, summary, manifest)


def _check_comparison(run_dirs: Sequence[Path], page: Path) -> None:
    """Raise `InputError` with all that is wrong with what is asked."""
    where, faults = "tis report", []
    if not 2 <= len(run_dirs) <= MAX_COMPARED:
        faults.append(Fault(where, "--compare", f"needs 2 to {MAX_COMPARED} runs", len(run_dirs)))
    real = [path.resolve() for path in run_dirs]
    for i, path in enumerate(run_dirs):
        if real.index(real[i]) < i:
            faults.append(Fault(where, "--compare", "must be different runs, this one comes twice", str(path)))
    if page.suffix not in _PAGES:
        faults.append(Fault(where, "--out", f"must end in {_PAGES[0]}", str(page)))
    if faults:
        raise InputError(faults)


def _names(run_dirs: Sequence[Path]) -> list[str]:
    """Return a short name for each run: its folder's, with as many parents as it takes to tell them apart."""
    paths = [path.resolve() for path in run_dirs]
    for depth in range(1, max(len(path.parts) for path in paths) + 1):
        names = ["/".join(path.parts[-depth:]) for path in paths]
        if len(set(names)) == len(names):
            return names
    raise AssertionError("paths that differ have names that differ")


def _need_bokeh() -> None:
    if not can_report():
        raise InputError(Fault("tis report", "", f"needs Bokeh: {GET_REPORT}"))
