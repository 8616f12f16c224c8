"""``run.mcap`` of a run folder: its logs, summary and manifest.

It is merged by `tis merge`, and at the end of a run in the background: the summary takes about as long.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final, NamedTuple, get_args

from rich.console import Console
from rich.markup import escape

from tis.common.channels import Side
from tis.common.errors import EXIT_LOSSY_RECOVERY, EXIT_OK, DataError, Fault
from tis.common.runtime.log_parts import companion_logs
from tis.common.scenario import Scenario
from tis.common.sources.provenance import MODEL_FILES
from tis.common.units import s_to_ns
from tis.deploy.logs.log_file import truncated_start
from tis.deploy.logs.log_paths import log_files
from tis.deploy.logs.merge import Conclusion, Merged, merge_logs, partial_of
from tis.deploy.logs.read.clocks import CLOCK_TOPICS, Clocks
from tis.deploy.logs.read.load import load_run, scenario_in
from tis.deploy.logs.viewer.draw_metrics import line
from tis.deploy.logs.viewer.drawn import Drawn, RunTopics
from tis.deploy.shell import run_dir as folder
from tis.patient_side.models import read_models

_ATTACHED: Final = (folder.SCENARIO_FILE, *MODEL_FILES, folder.MANIFEST_FILE, folder.SUMMARY_FILE)


class Opening(NamedTuple):
    """The log lines at the begin of a merged file: the run's command, and warnings of identification."""

    command: str = ""
    warnings: tuple[str, ...] = ()


def merge_run(
    run_dir: Path,
    scenario: Scenario,
    clocks: Clocks,
    opening: Opening,
    concluded: Callable[[], object] = lambda: None,
) -> Merged:
    """Write ``run.mcap`` from the logs of a folder; raises `DataError` when there are none.

    ``concluded`` is called when only the end of the run is missing; it returns once summary and manifest exist.
    """
    logs = logs_in(run_dir)
    if not logs:
        raise DataError(Fault(str(run_dir), "", "holds no log that could be merged"))
    end_ns = s_to_ns(scenario.duration_s)

    def conclude() -> Conclusion:
        concluded()
        attachments = {name: (run_dir / name).read_bytes() for name in _ATTACHED if (run_dir / name).is_file()}
        return Conclusion(
            attachments, tuple(_last_lines(folder.read_json(run_dir / folder.SUMMARY_FILE) or {}, end_ns))
        )

    models = folder.model_file(run_dir)
    arms = {model.hand: model.arm for model in read_models(models)} if models.is_file() else {}
    topics = RunTopics.of(scenario, arms)
    lines = _first_lines(scenario, opening)
    merged = merge_logs(logs, run_dir / folder.MERGED_FILE, topics, clocks, lines, conclude, end_ns)
    absent = [f"{side}.mcap is missing or empty" for side in get_args(Side) if side not in logs]
    return Merged(merged.n_messages, merged.n_drawn, (*absent, *merged.problems))


def can_merge(run_dir: Path) -> bool:
    """Tell whether the folder holds a log."""
    return bool(logs_in(run_dir))


def logs_in(run_dir: Path) -> dict[Side, list[Path]]:
    """Return the non-empty logs of a folder, by side."""
    found = {
        side: [
            path for path in (*paths, *companion_logs(run_dir, side)) if path.is_file() and not truncated_start(path)
        ]
        for side, paths in log_files(run_dir).items()
    }
    return {side: paths for side, paths in found.items() if paths}


def merge_again(run_dir: Path, out: Console, err: Console) -> int:
    """Merge a run folder's logs; return `EXIT_LOSSY_RECOVERY` when one is missing or damaged. Raises `DataError`."""
    logs = load_run(run_dir, CLOCK_TOPICS)
    scenario = folder.read_scenario(run_dir, scenario_in(logs))
    summary = folder.read_json(run_dir / folder.SUMMARY_FILE) or {}
    model = summary.get("identification")
    warnings = folder.texts_in(model.get("warnings") if isinstance(model, dict) else None)
    merged = merge_run(run_dir, scenario, logs.clocks.models(), Opening(str(summary.get("command", "")), warnings))
    print_merged(run_dir, merged, out)
    for problem in merged.problems:
        err.print(escape(f"tis: {run_dir}: {problem}; the rest was merged"), style="red", soft_wrap=True)
    return EXIT_LOSSY_RECOVERY if merged.problems else EXIT_OK


def print_merged(run_dir: Path, merged: Merged, out: Console) -> None:
    """Print path and size of the merged file."""
    path = run_dir / folder.MERGED_FILE
    n_messages = sum(merged.n_messages.values())
    size_mb = path.stat().st_size * 1e-6
    text = f"Merged: {path}, {size_mb:.1f} MB: {n_messages} records, "
    text += f"and {merged.n_drawn} messages for viewers to draw (poses, errors, delays)"
    out.print(escape(text), soft_wrap=True)


def _first_lines(scenario: Scenario, opening: Opening) -> Iterator[Drawn]:
    yield line(0, "INFO", "tis", f"run of {scenario.name}, seed {scenario.seed}: {opening.command}")
    for text in opening.warnings:
        yield line(0, "WARNING", "tis", text)


def _last_lines(summary: Mapping[str, Any], end_ns: int) -> Iterator[Drawn]:
    for text in folder.texts_in(summary.get("problems")):
        yield line(end_ns, "ERROR", "tis", text)
    verdicts = summary.get("verdicts")
    for verdict in verdicts if isinstance(verdicts, list) else ():
        if isinstance(verdict, dict) and isinstance(verdict.get("line"), str):
            yield line(end_ns, "INFO" if verdict.get("outcome") == "met" else "WARNING", "tis", verdict["line"])


_MIN_PROCESS_BYTES: Final = 8_000_000


class Merging:
    """A merge that runs in another process, or, without one, when its result is requested."""

    def __init__(self, inline: Callable[[], Merged], process: Connection | None = None) -> None:
        self._inline, self._process = inline, process

    def concluded(self) -> None:
        """Signal that summary and manifest are in the run folder."""
        if self._process is not None:
            with suppress(OSError):  # it has failed already; merged() reports it
                self._process.send(None)

    def merged(self) -> Merged:
        """Wait for the merged file; raises `DataError` when the merge fails."""
        if self._process is None:
            return self._inline()
        try:
            found: Merged | tuple[Fault, ...] = self._process.recv()
        except EOFError:
            rule = "cannot be made: the process that merges was killed"
            raise DataError(Fault(folder.MERGED_FILE, "", rule)) from None
        if isinstance(found, Merged):
            return found
        raise DataError(found)


@contextmanager
def merging(run_dir: Path, scenario: Scenario, clocks: Clocks, opening: Opening) -> Iterator[Merging]:
    """Merge a run's logs while the block summarises them; a block that fails leaves no file.

    Large logs are merged in a separate process.
    """
    work = (run_dir, scenario, clocks, opening)
    inline = partial(merge_run, *work)
    if sum(path.stat().st_size for paths in logs_in(run_dir).values() for path in paths) < _MIN_PROCESS_BYTES:
        yield Merging(inline)
        return
    # a forked child would inherit locks that other threads hold
    context = get_context("spawn")
    ours, its = context.Pipe()
    process = context.Process(target=_merge_process, args=(its, *work), name="merge")
    process.start()
    # the parent keeps no copy of the child's end, or a killed child would not show as EOF
    its.close()
    try:
        yield Merging(inline, ours)
    except BaseException:
        process.terminate()
        raise
    finally:
        ours.close()
        process.join()
        partial_of(run_dir / folder.MERGED_FILE).unlink(missing_ok=True)


def _merge_process(
    summarising: Connection, run_dir: Path, scenario: Scenario, clocks: Clocks, opening: Opening
) -> None:
    with suppress(EOFError, BrokenPipeError, KeyboardInterrupt):  # the parent has given up
        try:
            summarising.send(merge_run(run_dir, scenario, clocks, opening, summarising.recv))
        except DataError as error:
            summarising.send(error.faults)
