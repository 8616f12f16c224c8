"""Commands that compute many twins: `compare` and `paper`."""

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape

from tis.common.errors import Fault, InputError
from tis.deploy.cli.group import (
    Commands,
    EstimatorsOption,
    JobsOption,
    JsonOption,
    OptionalScenarioArg,
    SchedulerOption,
    SeedOption,
    SetOption,
    StudyFolderOption,
    TrialDurationOption,
    TrialsOption,
)
from tis.deploy.shell.guard import ERR, OUT, guarded, words_to

app = Commands("Studies")


_SweepOption = Annotated[
    list[str] | None,
    typer.Option(
        "--sweep",
        metavar="a.b=V,V,...",
        help="Vary a field of the scenario; FIRST..LAST:COUNT[:log] is a range. Several span a grid.",
    ),
]


@app.command()
@guarded
def compare(
    scenario: OptionalScenarioArg = None,
    study: Annotated[
        Path | None,
        typer.Option(metavar="FILE.yaml", help="A study file, which names scenario, settings, axes and estimators."),
    ] = None,
    estimators: EstimatorsOption = None,
    trials: TrialsOption = None,
    people: Annotated[
        str | None, typer.Option(metavar="D,E", help="People whose trials are compared, instead of --trials.")
    ] = None,
    seeds: Annotated[
        int | None, typer.Option(min=1, help="Seeds per trial (1), or per synthetic source (5).")
    ] = None,
    sweeps: _SweepOption = None,
    zipped: Annotated[bool, typer.Option("--zip", help="Take the values of several sweeps side by side.")] = False,
    settings: SetOption = None,
    seed: SeedOption = None,
    duration_s: TrialDurationOption = None,
    jobs: JobsOption = None,
    scheduler: SchedulerOption = None,
    out_dir: StudyFolderOption = None,
    as_json: JsonOption = False,
    page: Annotated[
        Path | None, typer.Option(help="Compute and write the page that compares the estimators instead.")
    ] = None,
    definitions: Annotated[
        bool,
        typer.Option(
            "--definitions",
            help="Compare definitions of the error instead: ours on recorded trials, beside published figures.",
        ),
    ] = False,
) -> int:
    """Compare estimators on the same arrivals, over trials, seeds and networks, in virtual time.

    To compare runs, see tis report --compare.

    Recorded trials use models trained on the other subjects, if there are any,
    whatever the scenario's identification.train is, unless it names a model
    file. To train on the first rows of each trial instead:
    --set identification.train=own_head.
    """
    from tis.deploy.compare.engine.compute import workers_of

    given: dict[str, Any] = {"scenario": scenario, "estimators": estimators, "trials": trials, "n_seeds": seeds}
    given |= {"study": study, "people": people, "sweeps": sweeps, "zipped": zipped or None, "settings": settings}
    given |= {"seed": seed, "duration_s": duration_s}
    out = words_to(as_json)
    workers = workers_of(jobs, scheduler, lambda text: ERR.print(escape(text), style="dim", soft_wrap=True))
    if definitions:
        from tis.deploy.studies.definitions.command import compare_definitions

        return compare_definitions(given, page, out_dir, as_json, workers, out, ERR)
    if page is not None:
        from tis.deploy.studies.estimators.page import write_page

        if as_json or any(value is not None for value in given.values()):
            raise InputError(Fault("tis compare", "--page", "must be given without a scenario or other options"))
        return write_page(page, out_dir, workers, out, ERR)
    from tis.deploy.compare.command import compare_given

    return compare_given(given, out_dir, as_json, workers, out, ERR)


@app.command()
@guarded
def paper(
    path: Annotated[
        str | None, typer.Option(help="Folder of JIGSAWS; by default TIS_JIGSAWS, else data/jigsaws.")
    ] = None,
    task: Annotated[str, typer.Option(help="Task of the trial.")] = "Suturing",
    trial: Annotated[str, typer.Option(help="Subject and repetition.")] = "D002",
    seed: Annotated[int, typer.Option(min=0, help="Seed of every random number.")] = 7,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="The page to write; by default runs/paper.md, or with --methods runs/methods.md.",
        ),
    ] = None,
    folder: Annotated[
        Path | None,
        typer.Option(help="Folder of figures, tables and twins; by default runs/paper, or runs/methods."),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Compute one of the eight tables of twins, or few twins of each method.")
    ] = False,
    methods: Annotated[
        bool,
        typer.Option("--methods", help="Measure the paper's comparison of methods instead; a second call resumes."),
    ] = False,
    estimators: Annotated[
        str | None,
        typer.Option(metavar="A,B,C", help="Methods to measure, with --methods; by default all that there are."),
    ] = None,
    jobs: JobsOption = None,
) -> int:
    """Recompute the paper's tables in virtual time and write them beside the printed ones as a page.

    With --methods each adjective of its table "Comparison of Different
    Methods" becomes a measured figure: on JIGSAWS, or without recordings on a
    synthetic population.
    """
    from tis.deploy.shell.run_dir import page_file
    from tis.deploy.studies.paper.cells import Trial
    from tis.deploy.studies.paper.command import write_paper

    if methods:
        from tis.deploy.studies.methods.command import Options, write_methods

        page, place = out or page_file("methods.md"), folder or Path("runs") / "methods"
        return write_methods(Options(path, task, seed, estimators, page, place, quick, jobs), OUT, ERR)
    if estimators is not None:
        raise InputError(Fault("tis paper", "--estimators", "must be given with --methods"))
    page, place = out or page_file("paper.md"), folder or Path("runs") / "paper"
    return write_paper(Trial(path, task, trial, seed), page, place, quick, jobs, OUT, ERR)
