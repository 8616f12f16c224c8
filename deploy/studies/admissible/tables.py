"""Tables of a study for a terminal, and as CSV."""

from collections.abc import Mapping
from functools import partial
from typing import Any, Final

from rich.console import Group, RenderableType
from rich.text import Text

from tis.deploy.present.numbers import number
from tis.deploy.present.table import OPEN, Column, Table
from tis.deploy.studies.admissible.criterion import Limit

Report = Mapping[str, Any]
CAPTION: Final = (
    "share: of the box; alone: how far an axis may go while the others are at their best; fresh: places drawn inside "
    "and outside of the region, and how many of them a fresh set of seeds judges otherwise"
)
_Wrapped: Final = partial(Column, wraps=True)


def view(report: Report) -> RenderableType:
    """Return the study for a terminal: the regions, then the profiles."""
    parts: list[RenderableType] = [Text(headline(report), style="bold"), Text(), regions(report).terminal(OPEN)]
    parts.append(Text(f"\n{CAPTION}", style="dim"))
    if report["profiles"]:
        parts += [Text(), profiles(report).terminal(OPEN), Text(f"\n{profiles_note(report)}", style="dim")]
    return Group(*parts)


def people_words(report: Report) -> str:
    """Return how many persons the confidence rests on, and whether they are synthetic."""
    people = report["persons"]
    return f"{len(people)} {'synthetic people' if people and report['synthetic'] == people else 'people'}"


def headline(report: Report) -> str:
    """Return limits, box and persons as a sentence."""
    limits = " and ".join(Limit(**limit).text for limit in report["limits"])
    limits += " holds" if len(report["limits"]) == 1 else " hold"
    axes = ", ".join(f"{axis['path']} {axis['first']:g} to {axis['last']:g}" for axis in report["axes"])
    seeds = report["n_seeds"]
    people, made = report["persons"], report["synthetic"]
    of_seeds = people[0].startswith("synthetic") if people else False
    some = f"; synthetic: {', '.join(made)}" if made and made != people else ""
    named = "" if of_seeds else f" ({', '.join(people)}{some})"
    of = f"{people_words(report)}{named}"
    each = "" if of_seeds or seeds == 1 else f", {seeds} seeds for each trial"
    return (
        f"{report['scenario']}: networks in which {limits} with 95 % confidence over {of}{each}; {axes}; "
        f"trained on {report['trained_on']}."
    )


def border_csv(report: Report) -> str:
    """Return one line for each estimator and border point, in order along the border."""
    return Table.of_records(
        [{"estimator": name, **values} for name, about in report["estimators"].items() for values in about["border"]]
    ).csv()


def points_csv(report: Report) -> str:
    """Return one line for each judged network and estimator, with its bounds; the kind is border or check."""
    limits = [Limit(**limit).text for limit in report["limits"]]
    return Table.of_records(
        [
            {
                "kind": point["kind"],
                **point["at"],
                "estimator": estimator,
                "inside": found["inside"],
                "margin": found["margin"],
                **{f"bound {limit}": bound for limit, bound in zip(limits, found["bounds"], strict=True)},
            }
            for point in report["points"]
            for estimator, found in point["verdicts"].items()
        ]
    ).csv()


def profiles_note(report: Report) -> str:
    """Return what the columns of `profiles` mean."""
    tried = report["profiles_tried"]
    most = max((one["copies"] for one in tried), default=1)
    return (
        "mean delay and loss of the forward link by its models, outages counted as loss; yes: admissible; "
        "with ...: the cheapest redundancy that makes it so, and what the surgeon then sends; "
        f"no: not admissible, with none of {len(tried)} redundancies up to {most} copies either"
    )


def regions(report: Report) -> Table:
    """Return the share of the box and the reach along each axis, by estimator."""
    axes = [
        _Wrapped(f"{axis['path'].split('.')[-1]} alone", show="{:.0f}".format if axis["whole"] else number)
        for axis in report["axes"]
    ]
    share = _Wrapped("share", show=lambda share: f"{100 * share:.1f} %")
    rows = []
    for name, about in report["estimators"].items():
        check = about["check"]
        rows.append(
            [
                name,
                about["share"],
                *(about["alone"][axis["path"]] for axis in report["axes"]),
                str(about["n_rays"]),
                f"{check['optimistic']}/{check['n_inside']}",
                f"{check['overlooked']}/{check['n_outside']}",
            ]
        )
    columns: list[str | Column] = ["estimator", share, *axes, *map(_Wrapped, ("rays", "fresh in", "out"))]
    return Table("The region of each estimator", columns, rows)


def profiles(report: Report) -> Table:
    """Return delay and loss of each profile, and whether it is admissible, by estimator."""
    names = list(report["estimators"])
    rows = []
    for one in report["profiles"]:
        forward = one["forward"]
        lost = 100 - (100 - forward["loss_pct"]) * (100 - forward["outage_pct"]) / 100
        rows.append([one["name"], forward["mean_ms"], f"{lost:.2g}", *(_verdict(one, name) for name in names)])
    columns: list[str | Column] = ["profile", *map(_Wrapped, ("ms", "loss %", *names))]
    return Table("Profiles of the library as the network of this scenario", columns, rows)


def _verdict(one: Mapping[str, Any], name: str) -> str:
    if one["verdicts"][name]["inside"]:
        return "yes"
    if one["fault"] is not None:
        return "refused"
    helped = one["redundancy"][name]
    if helped is None:
        return "no"
    return f"with {helped['text']}: {number(helped['packets_per_s'])}/s, {number(helped['bytes_per_s'] / 1000)} kB/s"
