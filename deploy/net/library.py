"""Commands ``tis net profiles`` and ``tis net stages``: the library, one profile, and the reference of all stages."""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, get_args

from rich.console import Console
from rich.markup import escape

from tis.common.channels import Direction
from tis.common.errors import EXIT_OK, Fault, InputError
from tis.common.runtime.scenario_files import load_traces
from tis.common.scenario.faults import meant
from tis.common.scenario.profile import Number, Profile, numeric_paths
from tis.deploy.net.profiles import find_profile, shipped_names
from tis.deploy.net.stage_reference import Kind, Parameter, network_page, sections
from tis.deploy.present.numbers import known
from tis.deploy.present.table import PLAIN, Column, Table
from tis.deploy.shell import run_dir as folder
from tis.netem.expected.figures import DirectionFigures, direction_figures
from tis.netem.expected.simulate import IN_ORDER_HZ, in_order


class Figures(NamedTuple):
    """Figures of a direction: as its packets have them that keep its order, and as they are drawn."""

    in_order: DirectionFigures
    drawn: DirectionFigures


_Ways = dict[Direction, Figures]

_MANY: Final = 5
_ROOMY: Final = 110
_POINTS: Final = "points"
_WAYS: Final = ("forward", "feedback")

_Place = tuple[str, ...]


class NumberRow(NamedTuple):
    """One row: path, value, and the profile's entry with source and basis."""

    of: str
    value: str
    number: Number


def number_rows(profile: Profile) -> list[NumberRow]:
    """Return the rows of a profile in its order; every number belongs to exactly one row."""
    network = profile.partial()
    alike = _alike(profile, network)
    grouped: dict[tuple[_Place, int], tuple[Number, list[_Place]]] = {}
    for path in numeric_paths(network):
        number = profile.basis_of(path)
        if number is None or (alike and path[0] == "feedback"):
            continue
        base = path[: path.index(_POINTS) + 1] if _POINTS in path else path
        grouped.setdefault((base, profile.numbers.index(number)), (number, []))[1].append(path)
    return [_row(base, number, paths, network, alike) for (base, _), (number, paths) in grouped.items()]


def _alike(profile: Profile, network: Mapping[str, Any]) -> bool:
    """Tell whether both directions have equal values with equal sources."""
    forward, feedback = (network.get(way) for way in _WAYS)
    if forward != feedback or not forward:
        return False
    return all(
        profile.basis_of(("forward", *path)) == profile.basis_of(("feedback", *path))
        for path in numeric_paths(forward)
    )


def _row(base: _Place, number: Number, paths: list[_Place], network: Mapping[str, Any], alike: bool) -> NumberRow:
    of = ("both", *base[1:]) if alike and base[0] in _WAYS else base
    if base[-1] != _POINTS:
        return NumberRow(".".join(of), f"{_value(network, base):g}", number)
    places = sorted({int(path[len(base)]) for path in paths})
    points = [_value(network, (*base, str(place))) for place in places]
    if len(points) == 1:
        return NumberRow(".".join((*of, str(places[0]))), _point(points[0]), number)
    return NumberRow(".".join(of), f"{len(points)} points, {_point(points[0])} to {_point(points[-1])}", number)


def _point(point: Mapping[str, float]) -> str:
    return f"p {point['p']:g}: {point['delay_ms']:g} ms"


def _value(tree: Any, path: _Place) -> Any:
    for step in path:
        tree = tree[int(step)] if isinstance(tree, list) else tree[step]
    return tree


def list_profiles(out: Console, as_json: bool) -> int:
    """Print every profile of the library with its figures."""
    rows = [(profile, figures_of(profile)) for profile in map(find_profile, shipped_names())]
    if as_json:
        print(json.dumps({profile.name: _plain(profile, figures) for profile, figures in rows}, indent=1))  # noqa: T201
    else:
        print_library(rows, out)
    return EXIT_OK


def show_profile(name: str, out: Console, as_json: bool) -> int:
    """Print one profile with its numbers and sources."""
    profile = find_profile(name)
    figures = figures_of(profile)
    if as_json:
        whole = profile.model_dump(mode="json", exclude={"network"}) | {"network": profile.partial()}
        print(json.dumps(whole | _plain(profile, figures), indent=1))  # noqa: T201
    else:
        print_profile(profile, figures, out)
    return EXIT_OK


def figures_of(profile: Profile) -> _Ways:
    """Compute a profile's figures for both directions; those of two that are alike are equal."""
    network, traces = profile.network, load_traces(profile.network)
    drawn = {direction: direction_figures(network, direction, traces) for direction in get_args(Direction)}
    bare = [pipeline.model_copy(update={"rate": None}) for pipeline in (network.forward, network.feedback)]
    is_alike = bare[0] == bare[1] and drawn["forward"] == drawn["feedback"]
    forward = Figures(in_order(network, "forward", drawn["forward"], traces), drawn["forward"])
    if is_alike:
        return {"forward": forward, "feedback": forward}
    feedback = Figures(in_order(network, "feedback", drawn["feedback"], traces), drawn["feedback"])
    return {"forward": forward, "feedback": feedback}


def _plain(profile: Profile, figures: _Ways) -> dict[str, Any]:
    return {
        "title": profile.title,
        "figures": {direction: of.drawn._asdict() for direction, of in figures.items()},
        "in_order": {direction: of.in_order._asdict() for direction, of in figures.items()},
    }


def print_library(rows: list[tuple[Profile, _Ways]], out: Console) -> None:
    """Print one line per profile, two where the directions differ; all figures are computed from the models.

    On a narrow terminal titles would push the figures out: they come below.
    """
    roomy = out.width >= _ROOMY
    columns: list[Column | str] = [
        "profile",
        Column("way", words=True),
        "mean ms",
        "p50",
        "p99",
        "loss %",
        "burst",
        "out %",
    ]
    columns += [Column("title", words=True, wraps=True)] if roomy else []
    lines = []
    for profile, figures in rows:
        alike = figures["forward"] == figures["feedback"]
        for direction in ("both",) if alike else ("forward", "feedback"):
            of = figures["forward" if direction == "both" else direction]  # type: ignore[index]
            first = direction != "feedback"
            title = [profile.title if first else ""] if roomy else []
            lines.append([profile.name if first else "", direction, *_cells(of.in_order), *title])
    look = PLAIN if roomy else PLAIN._replace(padding=(0, 1, 0, 0))
    out.print(Table("", columns, lines).terminal(look))
    out.print(
        f"One way, in ms, of messages that arrive, {IN_ORDER_HZ} a second in the profile's order: behind a late one "
        "others wait. What waits for a bit rate is not in it. Loss outside outages; out: share of time in outage. "
        "`tis net profiles NAME` has the delays as they are drawn, too."
    )
    if not roomy:
        titles = [(profile.name, profile.title) for profile, _ in rows]
        out.print(Table("", _wrapping("profile", "title"), titles).terminal(look))


def print_profile(profile: Profile, figures: _Ways, out: Console) -> None:
    """Print a profile with every number, its source and its basis."""
    out.print(f"[bold]{profile.name}[/bold]  {escape(profile.title)}")
    if profile.notes:
        out.print(escape(profile.notes))
    alike = figures["forward"] == figures["feedback"]
    for direction, of in [("both ways", figures["forward"])] if alike else figures.items():
        (mean, p50, p99, loss, burst, outage), drawn = _cells(of.in_order), _cells(of.drawn)
        out.print(
            f"{direction}: mean {mean} ms, p50 {p50}, p99 {p99} in order at {IN_ORDER_HZ} a second"
            f" (as drawn: mean {drawn[0]}, p50 {drawn[1]}, p99 {drawn[2]})"
            + f"; loss {loss} %, mean burst {burst}; outage {outage} %"
            + (f"; stalled {known(of.drawn.stall_pct)} %" if of.drawn.stall_pct else "")
        )
    found = number_rows(profile)
    lines = [(row.of, row.value, row.number.basis, row.number.source, row.number.note) for row in found]
    out.print(Table("", _wrapping("number", "value", "basis", "source", "note"), lines).terminal(PLAIN))
    for name, text in profile.sources.items():
        out.print(f"{name}: {escape(text)}")


def _cells(of: DirectionFigures) -> tuple[str, ...]:
    values = (of.mean_ms, of.p50_ms, of.p99_ms, of.loss_pct, of.mean_burst, of.outage_pct)
    return tuple(known(value) for value in values)


def _wrapping(*heads: str) -> list[Column]:
    return [Column(head, words=True, wraps=True) for head in heads]


def print_stages(name: str | None, out: Console) -> int:
    """Print one line per kind, or one section with every parameter; raises `InputError` for an unknown name.

    The name of a kind stands for its sections, with this kind alone.
    """
    found = {section.name: section for section in sections()}
    if name is None:
        lines = [
            (section.name if place == 0 else "", kind.name, _brief(kind))
            for section in found.values()
            for place, kind in enumerate(section.kinds)
        ]
        columns = [Column("stage", words=True), Column("kind", words=True), *_wrapping("parameters, [optional]")]
        out.print(Table("", columns, lines).terminal(PLAIN))
        out.print(
            "Stages act from the top down to ordering. `tis net stages NAME` explains one, `--out PAGE.md` all."
        )
        return EXIT_OK
    of_kind = {each.name: [kind for kind in each.kinds if kind.name == name] for each in found.values()}
    shown = {name: found[name].kinds} if name in found else {each: kinds for each, kinds in of_kind.items() if kinds}
    if not shown:
        near = meant(name, [*found, *(kind.name for each in found.values() for kind in each.kinds)])
        raise InputError(Fault("tis net stages", "NAME", f"must be one of {', '.join(found)}, or a kind{near}", name))
    for section, kinds in shown.items():
        out.print(escape(f"{section}: {found[section].meaning}"), soft_wrap=True)
        rows = list(_explained(kinds))
        out.print(Table("", _wrapping("kind", "parameter", "values", "default", "meaning"), rows).terminal(PLAIN))
    return EXIT_OK


def _explained(kinds: Sequence[Kind]) -> Iterator[tuple[str, ...]]:
    """Yield a row for each parameter; many that an earlier kind has alike are named in one row."""
    above: set[Parameter] = set()
    for kind in kinds:
        repeated = [one for one in kind.parameters if one in above]
        if len(repeated) < _MANY:
            repeated = []
        own = [one for one in kind.parameters if one not in repeated]
        for place, one in enumerate(own):
            yield kind.name if place == 0 else "", one.name, one.values, one.default_words, one.meaning
        if repeated:
            names = dict.fromkeys(one.name.partition(".")[0] for one in repeated)
            yield "" if own else kind.name, ", ".join(names), "as above", "", ""
        above |= set(kind.parameters)


def write_page(target: Path, out: Console) -> int:
    """Write the reference as a page; raises `DataError`."""
    folder.write(target, network_page())
    out.print(escape(str(target)), soft_wrap=True)
    return EXIT_OK


def _brief(kind: Kind) -> str:
    names = dict.fromkeys((one.name, one.required) for one in kind.parameters)
    return ", ".join(name if required else f"[{name}]" for name, required in names)
