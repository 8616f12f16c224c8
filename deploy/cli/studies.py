"""Commands that compute many twins: `compare`, `paper`, and `admissible`, the networks in which limits hold."""

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape

from tis.common.errors import Fault, InputError
from tis.deploy.cli import completion
from tis.deploy.cli.group import (
    Commands,
    EstimatorsOption,
    JobsOption,
    JsonOption,
    OptionalScenarioArg,
    Options,
    ScenarioArg,
    SchedulerOption,
    SeedOption,
    SetOption,
    StudyFolderOption,
    TrialDurationOption,
    TrialsOption,
)
from tis.deploy.shell.guard import ERR, OUT, words_to

app = Commands("Studies")


_Sweeps = Annotated[
    list[str] | None,
    typer.Option(
        "--sweep",
        metavar="a.b=V,V,...",
        help="Vary a field of the scenario; FIRST..LAST:COUNT[:log] is a range. Several span a grid.",
    ),
]


@dataclass(frozen=True)
class Compared(Options):
    """What is compared: a study's file, or a scenario with its variations."""

    scenario: OptionalScenarioArg = None
    study: Annotated[
        Path | None,
        typer.Option(metavar="FILE.yaml", help="A study file, which names scenario, settings, axes and estimators."),
    ] = None
    estimators: EstimatorsOption = None
    trials: TrialsOption = None
    people: Annotated[
        str | None, typer.Option(metavar="D,E", help="People whose trials are compared, instead of --trials.")
    ] = None
    n_seeds: Annotated[
        int | None, typer.Option("--seeds", min=1, help="Seeds per trial (1), or per synthetic source (6).")
    ] = None
    sweeps: _Sweeps = None
    zipped: Annotated[bool, typer.Option("--zip", help="Take the values of several sweeps side by side.")] = False
    settings: SetOption = None
    seed: SeedOption = None
    duration_s: TrialDurationOption = None

    def given(self) -> dict[str, Any]:
        """Return the options by name, None for those that are not given."""
        return {**vars(self), "zipped": self.zipped or None}


@app.command(example="tis compare default --estimators hold,innovations_kf --seeds 6")
def compare(
    *,
    compared: Compared,
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

    JIGSAWS trials use models trained on the other subjects, if there are any,
    whatever the scenario's identification.train is, unless it names a model
    file. To train on the first rows of each trial instead:
    --set identification.train=own_head. Tables are trained on as the scenario
    says.
    """
    from tis.deploy.compare.engine.compute import workers_of

    given, out = compared.given(), words_to(as_json)
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


@app.command(example="tis paper --quick")
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
        typer.Option(
            metavar="A,B,C",
            help="Methods to measure, with --methods; by default all that there are.",
            autocompletion=completion.estimators,
        ),
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


class Track(StrEnum):
    """Movements of the protocol, as values of an option."""

    OPEN = "open"
    JIGSAWS = "jigsaws"


@app.command(example="tis score innovations_kf --quick")
def score(
    *,
    estimators: Annotated[
        list[str],
        typer.Argument(
            metavar="ESTIMATOR",
            help="A shipped estimator, module:factory, or the command of a process, quoted.",
            autocompletion=completion.estimators,
        ),
    ],
    track: Annotated[Track, typer.Option(help="Synthetic movements, or your own copy of JIGSAWS.")] = Track.OPEN,
    quick: Annotated[bool, typer.Option("--quick", help="A few settings only: no row of the scoreboard.")] = False,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Other people and arrivals than the protocol's, to see what is luck.")
    ] = None,
    seeds: Annotated[
        int | None,
        typer.Option(min=2, help="Instead of rows: how stable the ranking is under so many seeds."),
    ] = None,
    path: Annotated[
        Path | None, typer.Option(help="Folder of JIGSAWS; by default TIS_JIGSAWS, else data/jigsaws.")
    ] = None,
    jobs: JobsOption = None,
    out_dir: Annotated[
        Path | None, typer.Option("--out", help="Folder of rows, movements and models; by default runs/score.")
    ] = None,
    as_json: JsonOption = False,
) -> int:
    """Score an estimator under the frozen protocol: one row of the scoreboard.

    Everybody who scores has the same movements, networks and arrivals. The
    score is the error over hold's, as a mean over all settings, with its 95 %
    interval over people.
    """
    from tis.deploy.studies.score.command import score as score_estimators

    words = words_to(as_json)
    return score_estimators(estimators, track.value, quick, seed, seeds, path, out_dir, jobs, as_json, words, ERR)


class Reproduced(StrEnum):
    """Studies whose tables are committed, as values of an argument."""

    ESTIMATORS = "estimators"
    METHODS = "methods"
    PAPER = "paper"
    NETWORK = "network"


@app.command(example="tis reproduce estimators --quick")
def reproduce(
    *,
    study: Annotated[Reproduced, typer.Argument(metavar="STUDY", help="estimators, methods, paper or network.")],
    quick: Annotated[bool, typer.Option("--quick", help="A sample of the cells, in minutes.")] = False,
    jobs: JobsOption = None,
    out_dir: StudyFolderOption = None,
) -> int:
    """Compute the manual's tables again and compare them cell by cell.

    Says of each cell that was computed whether it is equal, within a tolerance
    that is stated first, or differs; times of the machine stand apart. The
    tables of recordings need your own copy of JIGSAWS (TIS_JIGSAWS).
    """
    from tis.deploy.studies.reproduce.command import reproduce as reproduce_study

    return reproduce_study(study.value, quick, out_dir, jobs, OUT, ERR)


class Price(StrEnum):
    """Prices of redundancy, as values of an option."""

    BYTES = "bytes"
    PACKETS = "packets"


_Limits = Annotated[
    list[str] | None,
    typer.Option("--limit", metavar="NAME=V", help="A figure's limit, or NAME<=V, NAME>=V. All must hold."),
]
_Over = Annotated[
    list[str] | None,
    typer.Option(metavar="a.b=FIRST..LAST[:log]", help="Field of the scenario that varies; several span a box."),
]
_People = Annotated[str | None, typer.Option(metavar="D,E", help="People, instead of --trials: all of theirs.")]
_Seeds = Annotated[
    int | None, typer.Option("--seeds", min=1, help="Seeds per trial (4), or synthetic people, a seed each (16).")
]
_Profiles = Annotated[
    str, typer.Option(metavar="all|none|A,B", help="Profiles of the library that are judged as networks, too.")
]
_MaxCopies = Annotated[
    int, typer.Option(min=1, max=64, help="Most copies of each sample that are tried for a profile outside.")
]
_Cheapest = Annotated[Price, typer.Option(help="Price of a redundancy: bytes or packets a second.")]
_Tolerance = Annotated[float, typer.Option(min=0.002, max=0.2, help="Error of the border, as a share of an axis.")]
_Points = Annotated[int, typer.Option("--points", min=1, help="Most networks of each border's search.")]
_Checks = Annotated[
    int, typer.Option("--checks", min=0, help="Networks judged again on fresh seeds, half of them inside.")
]


@dataclass(frozen=True)
class Searched(Options):
    """Limits, networks and effort of the search."""

    scenario: ScenarioArg
    limits: _Limits = None
    over: _Over = None
    estimators: EstimatorsOption = None
    trials: TrialsOption = None
    people: _People = None
    n_seeds: _Seeds = None
    settings: SetOption = None
    seed: SeedOption = None
    duration_s: TrialDurationOption = None
    profiles: _Profiles = "all"
    max_copies: _MaxCopies = 4
    cheapest_by: _Cheapest = Price.BYTES
    tolerance: _Tolerance = 0.02
    max_points: _Points = 150
    n_checks: _Checks = 20


@app.command(
    example="tis admissible default --limit rmse_3d_mm=2 \\\n  --over network.forward.delay.delay_ms=10..200"
)
def admissible(
    *,
    searched: Searched,
    jobs: JobsOption = None,
    scheduler: SchedulerOption = None,
    out_dir: StudyFolderOption = None,
    as_json: JsonOption = False,
) -> int:
    """Find the networks in which limits hold with 95 % confidence over people.

    The answer to "how bad may my network be?": the region of each estimator
    within the box of --over, its border found by adaptive sampling; the
    profiles of the library placed in it; and the least redundancy that helps
    those outside.
    """
    from tis.deploy.studies.admissible.command import admissible as find_admissible

    given = {**vars(searched), "cheapest_by": searched.cheapest_by.value}
    return find_admissible(given, out_dir, as_json, jobs, scheduler, words_to(as_json), ERR)


@dataclass(frozen=True)
class Touched(Options):
    """The loops, delays and walls of the search."""

    scenario: ScenarioArg
    couplings: Annotated[str, typer.Option(metavar="A,B,C", help="Couplings to compare.")] = (
        "position_force,wave,tdpa"
    )
    estimators: EstimatorsOption = None
    delays: Annotated[str, typer.Option(metavar="MS,MS,...", help="Delays of each way of the network, in ms.")] = (
        "5,15,25,50,100"
    )
    walls: Annotated[str, typer.Option(metavar="SOFT,STIFF", help="Softest and stiffest wall, in N/m.")] = "30,3000"
    steps: Annotated[
        int, typer.Option(min=0, max=20, help="Bisections of each border; each halves the ratio's logarithm.")
    ] = 5
    settings: SetOption = None
    seed: SeedOption = None
    duration_s: TrialDurationOption = None


@app.command(example="tis touch touch --set rate_hz=250 --duration-s 8")
def touch(
    *, touched: Touched, jobs: JobsOption = None, out_dir: StudyFolderOption = None, as_json: JsonOption = False
) -> int:
    """Find the stiffest wall that can be touched, over delays, by coupling.

    The answer to "up to which delay can I touch this?": of each coupling, and
    of position_force with each estimator, the stiffness up to which a twin is
    stable, by bisection, beside the limit that theory has.
    """
    from tis.deploy.studies.touch.command import touch as find_touched

    return find_touched(vars(touched), out_dir, as_json, jobs, words_to(as_json), ERR)
