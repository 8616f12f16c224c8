"""Command `admissible`: the networks in which limits hold."""

from enum import StrEnum
from typing import Annotated, Any

import typer

from tis.deploy.cli.group import (
    Commands,
    EstimatorsOption,
    JobsOption,
    JsonOption,
    ScenarioArg,
    SchedulerOption,
    SeedOption,
    SetOption,
    StudyFolderOption,
    TrialDurationOption,
    TrialsOption,
)
from tis.deploy.shell.guard import ERR, guarded, words_to

app = Commands("Studies")


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
    int | None, typer.Option("--seeds", min=1, help="Seeds per trial (4), or synthetic people, a seed each (8).")
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


@app.command()
@guarded
def admissible(
    scenario: ScenarioArg,
    limits: _Limits = None,
    over: _Over = None,
    estimators: EstimatorsOption = None,
    trials: TrialsOption = None,
    people: _People = None,
    n_seeds: _Seeds = None,
    settings: SetOption = None,
    seed: SeedOption = None,
    duration_s: TrialDurationOption = None,
    profiles: _Profiles = "all",
    max_copies: _MaxCopies = 4,
    cheapest_by: _Cheapest = Price.BYTES,
    tolerance: _Tolerance = 0.02,
    max_points: _Points = 150,
    n_checks: _Checks = 20,
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

    given: dict[str, Any] = {"scenario": scenario, "limits": limits, "over": over, "estimators": estimators}
    given |= {"trials": trials, "people": people, "n_seeds": n_seeds, "settings": settings, "seed": seed}
    given |= {"duration_s": duration_s, "profiles": profiles, "max_copies": max_copies, "n_checks": n_checks}
    given |= {"cheapest_by": cheapest_by.value, "tolerance": tolerance, "max_points": max_points}
    return find_admissible(given, out_dir, as_json, jobs, scheduler, words_to(as_json), ERR)
