"""The answer of a study in words, and its tables for a terminal, a page and as CSV."""

from collections.abc import Mapping, Sequence
from functools import partial
from math import ceil, floor, log10
from typing import Any, Final

from rich.console import Group, RenderableType
from rich.text import Text

from tis.deploy.compare.results.pooled import ENOUGH_PEOPLE
from tis.deploy.present.notices import notices
from tis.deploy.present.numbers import number
from tis.deploy.present.table import OPEN, Column, Table
from tis.deploy.studies.admissible.criterion import Limit

Report = Mapping[str, Any]
_ALONE: Final = "share: of the box; alone: how far an axis may go while the others are at their best; "
_CAPTION: Final = (
    "bound: one-sided 95 % bound of the mean over people, which the limit holds, beside the people's own figure; "
    "both at the border; fresh: places drawn inside and outside of the region, and how many of them a fresh set of "
    "seeds judges otherwise"
)
_SHOWN_WARNINGS: Final = 6
_Wrapped: Final = partial(Column, wraps=True)


def view(report: Report) -> RenderableType:
    """Return the study for a terminal: the regions, then the profiles."""
    parts: list[RenderableType] = [Text(headline(report), style="bold"), Text(answer(report)), Text()]
    parts += [regions(report).terminal(OPEN), Text(f"\n{caption(report)}", style="dim")]
    if report["profiles"]:
        parts += [Text(), profiles(report).terminal(OPEN), Text(f"\n{profiles_note(report)}", style="dim")]
    return Group(*parts)


def answer(report: Report) -> str:
    """Return what each estimator admits, the most first, and what it rests on (oracle: literals, test_page).

    That is how far the axis may go, if there is one; else the share of the box.
    """
    limits = " and ".join(Limit(**limit).text for limit in report["limits"])
    ranked = sorted(report["estimators"].items(), key=lambda item: (-item[1]["share"], item[0]))
    best = ranked[0][0]
    if len(report["axes"]) == 1:
        words = {name: _reach(report, about) for name, about in ranked}
        where, unit = "holds", ""
    else:
        words = {name: f"{100 * about['share']:.1f} %" for name, about in ranked}
        where, unit = "holds in", " of the box of networks"
    text = f"With {best}, {limits} {where} {words.pop(best)}{unit}"
    text += "".join(f"; with {name} {own}" for name, own in words.items())
    if report["profiles"]:
        n_inside = sum(one["verdicts"][best]["inside"] for one in report["profiles"])
        text += f". Of {len(report['profiles'])} profiles of the library {n_inside} are admissible with {best}"
    return f"{text}. {_rests_on(report, best)}"


def _rests_on(report: Report, best: str) -> str:
    """Return whose confidence it is, and of the border the people's own figures beside what the limit holds."""
    n_people = len(report["persons"])
    few = f": too few for a claim about others, which takes {ENOUGH_PEOPLE}" if n_people < ENOUGH_PEOPLE else ""
    text = f"The 95 % confidence rests on {people_words(report)}{few}."
    own = [
        f"{limit['name']} is {_span(each['figures'])}, its bound {_span(each['bounds'])}"
        for limit, each in zip(report["limits"], report["estimators"][best]["at_border"], strict=False)
    ]
    at = f" What reaches the limit is the bound, not the people's own figure: at {best}'s border "
    return f"{text}{at}{'; '.join(own)}." if own else text


def _reach(report: Report, about: Mapping[str, Any]) -> str:
    """Return in words how far the only axis of a study may go."""
    (axis,) = report["axes"]
    path = axis["path"]
    if about["alone"][path] is None:
        return "nowhere"
    inside, outside = _ends(about, axis)
    if outside is None:
        return f"at all of {path.split('.')[-1]} {axis['first']:g} to {axis['last']:g}"
    way = "up to" if about["start"][path] == axis["first"] else "down to"
    return f"{way} {path.split('.')[-1]} = {inside} (no longer at {outside})"


def _ends(about: Mapping[str, Any], axis: Mapping[str, Any]) -> tuple[str | None, str | None]:
    """Return the last value inside and the first one outside, each away from the border to what was resolved."""
    inside, outside = about["alone"][axis["path"]], about["beyond"][axis["path"]]
    if inside is None or outside is None:
        return None if inside is None else f"{inside:.6g}", None
    step, way = 10.0 ** floor(log10(abs(outside - inside))), 1 if outside > inside else -1
    start, far = about["start"][axis["path"]], axis["last"] if way == 1 else axis["first"]
    near = max(way * start, floor(round(way * inside / step, 6)) * step)
    beyond = min(way * far, ceil(round(way * outside / step, 6)) * step)
    return f"{way * near + 0.0:.9g}", f"{way * beyond + 0.0:.9g}"


def _span(values: Sequence[float]) -> str:
    """Return the least and the largest of values, once where they read the same."""
    low, high = map(number, values)
    return low if low == high else f"{low} to {high}"


def caption(report: Report) -> str:
    """Return what the columns of `regions` mean."""
    return f"{_ALONE if len(report['axes']) > 1 else ''}{_CAPTION}"


def warnings(report: Report) -> list[str]:
    """Return the lines of the warnings for terminal and page."""
    return notices(report["warnings"], _SHOWN_WARNINGS, "admissible.json")


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
    """Return one line for each judged network and estimator, with figures and bounds; the kind is border or check."""
    names = [limit["name"] for limit in report["limits"]]
    limits = [Limit(**limit).text for limit in report["limits"]]
    return Table.of_records(
        [
            {
                "kind": point["kind"],
                **point["at"],
                "estimator": estimator,
                "inside": found["inside"],
                "margin": found["margin"],
                **dict(zip(names, found["figures"], strict=True)),
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
    """Return the share of the box, the reach along each axis, and figure and bound at the border, by estimator."""
    heads = [f"{axis['path'].split('.')[-1]} alone" for axis in report["axes"]]
    if is_one := len(report["axes"]) == 1:
        heads = [heads[0].replace("alone", "within"), "no longer at"]
    rows = []
    for name, about in report["estimators"].items():
        check, ends = about["check"], [_ends(about, axis) for axis in report["axes"]]
        at_border = about["at_border"] or [None] * len(report["limits"])
        rows.append(
            [
                name,
                *(ends[0] if is_one else (f"{100 * about['share']:.1f} %", *(inside for inside, _ in ends))),
                *(one and _span(one[what]) for one in at_border for what in ("figures", "bounds")),
                *(() if is_one else (str(about["n_rays"]),)),
                f"{check['optimistic']}/{check['n_inside']}",
                f"{check['overlooked']}/{check['n_outside']}",
            ]
        )
    for limit in report["limits"]:
        heads += [limit["name"], "bound"]
    named = (*heads, "fresh in", "out") if is_one else ("share", *heads, "rays", "fresh in", "out")
    columns: list[str | Column] = ["estimator", *map(_Wrapped, named)]
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
