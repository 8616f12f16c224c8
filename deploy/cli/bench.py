"""Benchmarks: ``tis bench``, each figure beside a reference measured in the same run."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from tis.common.errors import EXIT_OK, Fault, InputError
from tis.common.extras import GET_HOSTS
from tis.deploy.cli.group import Commands
from tis.deploy.shell.guard import OUT, can_certify, check_outputs

app = Commands(no_args_is_help=True, help="Measure speed and punctuality on this machine.")

_JsonFile = Annotated[Path | None, typer.Option("--json", help="Write the figures to this file.")]
_RunLength = Annotated[float, typer.Option(min=2, max=600, help="Length of each run, in s.")]


@app.command(example="tis bench netem")
def netem(
    seconds: Annotated[float, typer.Option(min=0.5, max=600, help="Measuring time per figure, s.")] = 5.0,
    beside: Annotated[
        Path | None,
        typer.Option(metavar="TIS", help="The tis of another checkout's environment: measure both in turn."),
    ] = None,
    rounds: Annotated[int, typer.Option(min=1, max=50, help="With --beside: how often each is measured.")] = 3,
    out: _JsonFile = None,
) -> int:
    """Measure the emulator's release error and throughput, beside a native Zenoh router."""
    from tis.deploy.bench.netem import bench_beside, bench_netem

    if beside is not None:
        return _measured(lambda: bench_beside(beside, seconds, rounds, OUT), out)
    return _measured(lambda: bench_netem(seconds, OUT), out)


@app.command(example="tis bench models --out draws.md")
def models(
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="The page to write; by default runs/emulator.md.")
    ] = None,
) -> int:
    """Write a page with the statistics of the emulator's models, a million packets each, beside tc-netem's."""
    from tis.deploy.bench.models import write_models_page
    from tis.deploy.shell.run_dir import page_file

    page = out or page_file("emulator.md")
    check_outputs(page)
    write_models_page(page, OUT)
    return EXIT_OK


@app.command(example="tis bench identification")
def identification() -> int:
    """Time the identification methods at three sizes, beside other packages if they are installed."""
    from tis.deploy.bench.identification import bench_identification

    return bench_identification(OUT)


@app.command(example="tis bench estimators")
def estimators() -> int:
    """Time a step of each estimator on precomputed arrivals."""
    from tis.deploy.bench.estimators import bench_estimators

    return bench_estimators(OUT)


@app.command(example="tis bench cells")
def cells(
    seconds: Annotated[float, typer.Option(min=3, max=3600, help="Length of each twin, in s.")] = 60.0,
    rounds: Annotated[int, typer.Option(min=1, max=50, help="Number of twins of each kind.")] = 5,
    out: _JsonFile = None,
) -> int:
    """Time a cell of `tis compare`, which keeps no logs, beside a twin with logs."""
    from tis.deploy.bench.cells import bench_cells

    return _measured(lambda: bench_cells(seconds, rounds, OUT), out)


@app.command(example="tis bench logs")
def logs(
    seconds: Annotated[float, typer.Option(min=60, max=3600, help="Length of the recordings, in s.")] = 120.0,
    whole: Annotated[
        bool, typer.Option("--whole", help="Measure an hour at 30 Hz and ten minutes at 1 kHz; takes 10 minutes.")
    ] = False,
    out: _JsonFile = None,
) -> int:
    """Measure the size of recordings on disk, and the time and memory to merge and report them."""
    from tis.deploy.bench.logs import bench_logs

    return _measured(lambda: bench_logs(seconds, whole, OUT), out)


@app.command(example="tis bench tick")
def tick(
    seconds: Annotated[float, typer.Option(min=2, max=600, help="Length of each twin, in s.")] = 10.0,
    rounds: Annotated[
        int, typer.Option(min=1, max=50, help="Number of twins; the least time of each part counts.")
    ] = 2,
    out: _JsonFile = None,
) -> int:
    """Time the parts of the patient's tick, with one hand and both, at 30 Hz and 1 kHz."""
    from tis.deploy.bench.tick import bench_tick

    return _measured(lambda: bench_tick(seconds, rounds, OUT), out)


@app.command(example="tis bench recording")
def recording(
    seconds: _RunLength = 20.0,
    rounds: Annotated[
        int, typer.Option(min=1, max=50, help="Number of runs with recording, and of as many without.")
    ] = 3,
    out: _JsonFile = None,
) -> int:
    """Measure the effect of recording on a live run at 1 kHz: missed ticks and lateness, with and without it."""
    from tis.deploy.bench.live_runs import bench_recording

    return _measured(lambda: bench_recording(seconds, rounds, OUT), out)


@app.command(example="tis bench security")
def security(
    seconds: _RunLength = 7.0,
    rounds: Annotated[int, typer.Option(min=1, max=50, help="Number of runs of each kind.")] = 3,
    out: _JsonFile = None,
) -> int:
    """Measure the price of passwords, TLS, audit and signing: time end to end, and processor time per message.

    The kinds take turns; each stands beside bare mtls, which is neither signed
    nor audited, of the same round. It takes some four minutes.
    """
    if not can_certify():
        raise InputError(Fault("tis bench security", "", f"needs the package cryptography: {GET_HOSTS}"))
    from tis.deploy.bench.live_runs import bench_security

    return _measured(lambda: bench_security(seconds, rounds, OUT), out)


def _measured(bench: Callable[[], Mapping[str, Any]], out: Path | None) -> int:
    """Measure, which prints the figures, and write them to a file if one is named; return the exit code."""
    check_outputs(out)
    figures = bench()
    if out is not None:
        from tis.deploy.shell.run_dir import write

        write(out, json.dumps(figures, indent=2) + "\n")
    return EXIT_OK
