"""Tables of a study for a terminal, and as CSV."""

from collections.abc import Sequence
from typing import Any, Final

from rich.console import Group, RenderableType
from rich.text import Text

from tis.deploy.present.numbers import NONE, number
from tis.deploy.present.table import OPEN, Column, Row, Table
from tis.deploy.studies.admissible.criterion import Limit

_CAPTION: Final = (
    "share: of the box; alone: how far an axis may go while the others are at their best; fresh: places drawn inside "
    "and outside of the region, and how many of them a fresh set of seeds judges otherwise"
)


def view(report: dict[str, Any]) -> RenderableType:
    """Return the study for a terminal: the regions, then the profiles."""
    parts: list[RenderableType] = [Text(headline(report), style="bold"), Text(), _regions(report)]
    parts.append(Text(f"\n{_CAPTION}", style="dim"))
    if report["profiles"]:
        parts += [Text("\nProfiles of the library as the network of this scenario"), *_profiles(report)]
    return Group(*parts)


def headline(report: dict[str, Any]) -> str:
    """Return limits, box and persons as a sentence."""
    limits = " and ".join(Limit(**limit).text for limit in report["limits"])
    limits += " holds" if len(report["limits"]) == 1 else " hold"
    axes = ", ".join(f"{axis['path']} {axis['first']:g} to {axis['last']:g}" for axis in report["axes"])
    seeds = report["n_seeds"]
    people = report["persons"]
    synthetic = people[0].startswith("synthetic") if people else False
    of = f"{len(people)} synthetic people" if synthetic else f"{len(people)} people ({', '.join(people)})"
    each = "" if synthetic or seeds == 1 else f", {seeds} seeds for each trial"
    return (
        f"{report['scenario']}: networks in which {limits} with 95 % confidence over {of}{each}; {axes}; "
        f"trained on {report['trained_on']}."
    )


def border_csv(report: dict[str, Any]) -> str:
    """Return one line for each estimator and border point, in order along the border."""
    return Table.of_records(
        [{"estimator": name, **values} for name, about in report["estimators"].items() for values in about["border"]]
    ).csv()


def points_csv(report: dict[str, Any]) -> str:
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


def _regions(report: dict[str, Any]) -> RenderableType:
    paths = [axis["path"] for axis in report["axes"]]
    head = ("share", *(f"{path.split('.')[-1]} alone" for path in paths), "rays", "fresh in", "out")
    rows = []
    for name, about in report["estimators"].items():
        check = about["check"]
        rows.append(
            [
                name,
                f"{100 * about['share']:.1f} %",
                *(_value(about["alone"][axis["path"]], axis["whole"]) for axis in report["axes"]),
                about["n_rays"],
                f"{check['optimistic']}/{check['n_inside']}",
                f"{check['overlooked']}/{check['n_outside']}",
            ]
        )
    return _terminal("estimator", head, rows)


def _value(value: float | None, is_whole: bool) -> str:
    return NONE if value is None else str(int(value)) if is_whole else number(value)


def _profiles(report: dict[str, Any]) -> list[RenderableType]:
    names = list(report["estimators"])
    rows = []
    for one in report["profiles"]:
        forward = one["forward"]
        lost = 100 - (100 - forward["loss_pct"]) * (100 - forward["outage_pct"]) / 100
        rows.append([one["name"], forward["mean_ms"], f"{lost:.2g}", *(_verdict(one, name) for name in names)])
    tried = report["profiles_tried"]
    most = max((one["copies"] for one in tried), default=1)
    note = (
        "mean delay and loss of the forward link by its models, outages counted as loss; yes: admissible; with ...: "
        "the cheapest redundancy that makes it so, and what the surgeon then sends; no: not admissible, with none of "
        f"{len(tried)} redundancies up to {most} copies either"
    )
    return [_terminal("profile", ("ms", "loss %", *names), rows), Text(f"\n{note}", style="dim")]


def _verdict(one: dict[str, Any], name: str) -> str:
    if one["verdicts"][name]["inside"]:
        return "yes"
    if one["fault"] is not None:
        return "refused"
    helped = one["redundancy"][name]
    if helped is None:
        return "no"
    return f"with {helped['text']}: {number(helped['packets_per_s'])}/s, {number(helped['bytes_per_s'] / 1000)} kB/s"


def _terminal(first: str, heads: Sequence[str], rows: Sequence[Row]) -> RenderableType:
    return Table("", (first, *(Column(head, wraps=True) for head in heads)), rows).terminal(OPEN)
