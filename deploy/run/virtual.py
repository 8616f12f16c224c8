"""Command `tis twin`: the nodes in virtual time, then the same conclusion as of a live run."""

import time
from pathlib import Path
from typing import Final

from msgspec import convert
from rich.console import Console
from rich.markup import escape

from tis.common.errors import EXIT_INVALID_RUN, EXIT_OK, Fault, InputError
from tis.common.records import CONTROL, ControlNote
from tis.common.runtime.process import command_line
from tis.common.runtime.recordings import load_recording
from tis.common.runtime.run_folders import RUNS, run_folder
from tis.common.scenario import Scenario
from tis.common.scenario.reading import digest
from tis.deploy.logs.read.load import load_run
from tis.deploy.run.conclude import EVERYTHING, Ending, Outputs, conclude
from tis.deploy.run.consistency import FateComparison, compare_fates
from tis.deploy.run.twin import build_sides, refuse_in_virtual_time, run_twin
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.guard import print_faults, print_warnings
from tis.deploy.shell.progress import RunTime

_MAX_SET_ASIDE_SHARE: Final = 0.05


def run_virtual(
    scenario: Scenario, run_dir: Path | None, against: Path | None, out: Console, err: Console,
    outputs: Outputs = EVERYTHING,
) -> int:  # fmt: skip
    """Run the twin, write summary, manifest and report, print the summary; return the exit code.

    ``against`` is the folder of a live run of the same scenario to compare fates with.
    """
    refuse_in_virtual_time(scenario)
    if against is not None:
        _check_same_scenario(scenario, against)
    live = None if against is None else load_run(against)
    notes = [] if live is None else [convert(row, ControlNote) for row in live.of("netem", CONTROL)]
    recording = load_recording(scenario)
    kept = None if live is None else live.attachments("netem")
    nodes, models, warnings = build_sides(scenario, notes, kept, recording)
    print_warnings(err, *scenario.surgeon.warnings(), *warnings)
    path = folder.create(run_dir or run_folder(RUNS, f"{scenario.name}_twin"), scenario)
    started_s = time.perf_counter()
    try:
        with RunTime(err, scenario.end_ns * 1e-9) as bar:
            run_twin(scenario, nodes, models, path, recording, bar.reached)
    except KeyboardInterrupt:
        text = (
            f"interrupted at {bar.now_s:.0f} s of run time: the logs up to there are in {path}, and its figures by "
        )
        err.print(escape(f"{text}`tis summarize {path}`; a twin begins anew"), style="yellow", soft_wrap=True)
        raise
    elapsed_s = time.perf_counter() - started_s
    err.print(f"{scenario.end_ns * 1e-9:g} s of run time took {elapsed_s:.2f} s of computing")
    code = conclude(path, scenario, Ending("twin", command_line(), EXIT_OK, {}, warnings), out, outputs)
    if live is None:
        return code
    found = compare_fates(live, load_run(path), scenario)
    out.print(escape(f"{found.n_compared} fates compared with {against}: {_comparison_text(found)}"), soft_wrap=True)
    print_faults(err, *(f"{against}: {text}; only the readable part was compared" for text in live.problems()))
    if found.set_aside_share > _MAX_SET_ASIDE_SHARE:
        print_warnings(err, f"{found.set_aside_share:.0%} of the packets were set aside and not compared")
    return code if found.identical else EXIT_INVALID_RUN


def _comparison_text(found: FateComparison) -> str:
    parts = [f"{found.n_different} differ", f"{found.n_in_one_only} packets were offered in one run only"]
    if found.n_moved:
        parts.append(
            f"{found.n_moved} were offered in another ms of run time, for which correlated delays, traces by time, "
            "outages, states, timeline or changes draw differently (each was compared with the models at its own ms)"
        )
    if found.n_set_aside:
        parts.append(
            f"{found.n_set_aside} were set aside: the network was changed while running but not in the twin, or a "
            "trace is missing"
        )
    return "; ".join(parts)


def _check_same_scenario(scenario: Scenario, against: Path) -> None:
    other = folder.read_scenario(against)
    if digest(other) != digest(scenario):
        raise InputError(
            Fault("tis twin", "--against", f"must be a run of this scenario ({digest(scenario)})", digest(other))
        )
