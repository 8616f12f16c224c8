"""Commands that compute many runs: `compare` and `paper`."""

from pathlib import Path
from typing import Annotated, Any

import typer

from deploy.cli.options import SeedOption, SetOption
from deploy.shell.guard import ERR, OUT, guarded

app = typer.Typer()


@app.command()
@guarded
def compare(
    scenario: Annotated[
        str | None,
        typer.Argument(metavar="SCENARIO", help="A scenario file (YAML), or the name of a shipped one."),
    ] = None,
    estimators: Annotated[
        str | None,
        typer.Option(metavar="A,B,C", help="Estimators, by name or module:factory; the scenario's when not given."),
    ] = None,
    trials: Annotated[
        str | None, typer.Option(metavar="D001,E003", help="Trials of the task; all in the folder when not given.")
    ] = None,
    seeds: Annotated[
        int | None, typer.Option(min=1, help="Seeds for each trial (1), or of a synthetic source (5).")
    ] = None,
    sweep: Annotated[
        str | None, typer.Option(metavar="a.b=V,V,...", help="One field of the scenario at several values.")
    ] = None,
    settings: SetOption = None,
    seed: SeedOption = None,
    duration_s: Annotated[
        float | None, typer.Option(help="At most so much of each trial, in s; all of it when not given.")
    ] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes; all cores when not given.")] = None,
    out_dir: Annotated[
        Path | None,
        typer.Option("--out", help="Folder of the results, where a second call goes on; below runs/ when not given."),
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the table to this file as well.")] = None,
    page: Annotated[
        Path | None, typer.Option(help="Instead: compute and write the page on estimators, docs/estimators.md.")
    ] = None,
) -> int:
    """Compare estimators on the same arrivals, over trials, seeds and networks, in virtual time.

    Recorded trials are estimated with models of the other subjects, where
    there are any, whatever the scenario's identification.train says, unless
    that names a model file. To train on the first rows of each trial instead:
    --set identification.train=own_head.
    """
    from deploy.compare.options import compare_or_page

    asked: dict[str, Any] = {"scenario": scenario, "estimators": estimators, "trials": trials, "n_seeds": seeds}
    asked |= {"sweep": sweep, "settings": settings, "seed": seed, "duration_s": duration_s}
    return compare_or_page(asked, page, out_dir, json_file, jobs, OUT, ERR)


@app.command()
@guarded
def paper(
    path: Annotated[
        str | None, typer.Option(help="Folder of JIGSAWS; TIS_JIGSAWS, or else data/jigsaws, when not given.")
    ] = None,
    task: Annotated[str, typer.Option(help="Task of the trial.")] = "Suturing",
    trial: Annotated[str, typer.Option(help="Subject and repetition.")] = "D002",
    seed: Annotated[int, typer.Option(min=0, help="Decides every random number.")] = 7,
    out: Annotated[Path, typer.Option("--out", "-o", help="The page to write.")] = Path("docs/paper.md"),
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes; all cores when not given.")] = None,
) -> int:
    """Compute the paper's tables again, in virtual time, and write them beside the paper's own as a page."""
    from deploy.paper.cells import Trial
    from deploy.paper.command import write_paper

    return write_paper(Trial(path, task, trial, seed), out, jobs, OUT, ERR)
