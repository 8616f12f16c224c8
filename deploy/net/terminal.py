"""Terminal output of ``tis net``: library, profile, probed path and fit."""

from collections.abc import Mapping
from math import isnan
from typing import Any, Final, NamedTuple

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from tis.common.channels import Direction
from tis.common.metrics.percentiles import TAIL, Summary, is_resolvable, uncertainties
from tis.common.scenario.profile import Number, Profile, numeric_paths
from tis.common.units import NS_PER_MS
from tis.deploy.net.probing.delay_figures import PathFigures
from tis.deploy.net.probing.probe import Probed
from tis.netem.expected.figures import DirectionFigures
from tis.netem.fit.direction import DirectionFit

_POINTS: Final = "points"
_WAYS: Final = ("forward", "feedback")

Path = tuple[str, ...]


class NumberRow(NamedTuple):
    """One row: path, value, and the profile's entry with source and basis."""

    of: str
    value: str
    number: Number


def number_rows(profile: Profile) -> list[NumberRow]:
    """Return the rows of a profile in its order; every number belongs to exactly one row."""
    network = profile.partial()
    alike = _alike(profile, network)
    grouped: dict[tuple[Path, int], tuple[Number, list[Path]]] = {}
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


def _row(base: Path, number: Number, paths: list[Path], network: Mapping[str, Any], alike: bool) -> NumberRow:
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


def _value(tree: Any, path: Path) -> Any:
    for step in path:
        tree = tree[int(step)] if isinstance(tree, list) else tree[step]
    return tree


Figures = dict[Direction, DirectionFigures]

_UNKNOWN: Final = "?"
_ROOMY: Final = 110


def print_library(rows: list[tuple[Profile, Figures]], out: Console) -> None:
    """Print one line per profile, two where the directions differ; all figures are computed from the models."""
    roomy = out.width >= _ROOMY  # titles on a narrow terminal would push the figures out
    table = Table(box=None, padding=(0, 2 if roomy else 1, 0, 0))
    for heading in ("profile", "way"):
        table.add_column(heading, no_wrap=True)
    for heading in ("mean ms", "p50", "p99", "loss %", "burst", "out %"):
        table.add_column(heading, justify="right", no_wrap=True)
    if roomy:
        table.add_column("title", overflow="fold")
    for profile, figures in rows:
        alike = figures["forward"] == figures["feedback"]
        for direction in ("both",) if alike else ("forward", "feedback"):
            of = figures["forward" if direction == "both" else direction]  # type: ignore[index]
            first = direction != "feedback"
            title = [escape(profile.title) if first else ""] if roomy else []
            table.add_row(profile.name if first else "", direction, *_cells(of), *title)
    out.print(table)
    out.print("One way, in ms, of messages that arrive; loss outside outages; out: share of time in outage.")


def print_profile(profile: Profile, figures: Figures, out: Console) -> None:
    """Print a profile with every number, its source and its basis."""
    out.print(f"[bold]{profile.name}[/bold]  {escape(profile.title)}")
    if profile.notes:
        out.print(escape(profile.notes))
    alike = figures["forward"] == figures["feedback"]
    for direction, of in [("both ways", figures["forward"])] if alike else figures.items():
        mean, p50, p99, loss, burst, outage = _cells(of)
        out.print(
            f"{direction}: mean {mean} ms, p50 {p50}, p99 {p99}; loss {loss} %, mean burst {burst}; outage {outage} %"
            + (f"; stalled {_number(of.stall_pct)} %" if of.stall_pct else "")
        )
    table = Table(box=None, padding=(0, 2, 0, 0))
    for heading in ("number", "value", "basis", "source", "note"):
        table.add_column(heading, overflow="fold")
    for row in number_rows(profile):
        table.add_row(*map(escape, (row.of, row.value, row.number.basis, row.number.source, row.number.note)))
    out.print(table)
    for name, text in profile.sources.items():
        out.print(f"{name}: {escape(text)}")


def print_path(figures: PathFigures, out: Console, probed: Probed) -> None:
    """Print a record's figures, with the counts of the probe."""
    low, high = figures.losses.p_loss_interval
    share = 100 * figures.n_lost / figures.n
    out.print(
        f"{figures.n} messages, {figures.n - figures.n_lost} arrived, {figures.n_lost} lost: {share:.4g} % "
        f"(95 %: {100 * low:.4g} to {100 * high:.4g})"
    )
    if figures.n_runs:
        out.print(
            f"runs of losses {figures.n_runs}, mean {_number(figures.losses.mean_burst)}, "
            f"longest {figures.longest_run}"
        )
    uncertainty = {} if probed.clock.shared else delay_uncertainties(probed)
    delay = ", ".join(f"{name} {_figure(value, uncertainty.get(name))}" for name, value in figures.delay_ms.items())
    out.print(f"delay, ms: {delay}")
    varied = figures.variation
    out.print(
        f"variation, ms: PDV p99 {_number(varied.pdv_p99)} (RFC 5481), IPDV p50 {_number(varied.ipdv_p50)}, p99 "
        f"{_number(varied.ipdv_p99)} (RFC 3393), jitter {_number(varied.rtp_jitter)} (RFC 3550)"
    )
    out.print(f"correlation: {_correlation(figures.half_life)}")
    if figures.n_overtaken:
        out.print(f"overtaken by a later message: {figures.n_overtaken}")
    counts = {
        "duplicates": probed.paired.n_duplicates,
        "arrived after the timeout": probed.paired.n_late,
        "skipped, their send instant had passed": probed.n_skipped,
        "foreign messages on the key": probed.paired.n_foreign,
        "arrived before they were sent, because a clock was set": probed.paired.n_impossible,
    }
    for what, n in counts.items():
        if n:
            out.print(f"{what}: {n}")


def delay_uncertainties(probed: Probed) -> Summary:
    """Return the uncertainty of each delay figure, ms; none for ``std``, which an offset does not change."""
    arrived = probed.paired.delay_ns >= 0
    delay_ms, uncertainty_ms = (
        ns[arrived] / NS_PER_MS for ns in (probed.paired.delay_ns, probed.paired.uncertainty_ns)
    )
    return uncertainties(delay_ms, uncertainty_ms, TAIL, ("mean", "max"))


def print_fit(fits: dict[Direction, DirectionFit], out: Console, wanted: bool = False) -> None:
    """Print the candidates and the chosen fit of each direction."""
    seen: list[DirectionFit] = []
    for direction, fit in fits.items():
        if fit in seen:
            continue
        seen.append(fit)
        name = direction if sum(other is fit for other in fits.values()) == 1 else "both ways"
        out.print(f"[bold]{name}[/bold]: {fit.n} messages in {fit.duration_s:.3f} s, {fit.n_lost} lost")
        table = Table(box=None, padding=(0, 2, 0, 0))
        for heading in ("distribution", "KS", "BIC", "parameters"):
            table.add_column(heading, overflow="fold", justify="right" if heading in ("KS", "BIC") else "left")
        for candidate in fit.marginal.candidates:
            taken = candidate.name == fit.marginal.chosen
            parameters = {key: value for key, value in candidate.stage.items() if key not in ("kind", "points")}
            if "points" in candidate.stage:
                parameters["points"] = len(candidate.stage["points"])
            table.add_row(
                f"{candidate.name}{' <-' if taken else ''}",
                f"{candidate.ks:.4f}",
                "-" if candidate.bic is None else f"{candidate.bic:.0f}",
                escape(", ".join(f"{key} {value}" for key, value in parameters.items())),
            )
        out.print(table)
        for left_out in fit.left_out:
            out.print(f"left out: {left_out}", soft_wrap=True)
        out.print(f"taken: {fit.marginal.chosen} ({_why_taken(fit, wanted)})", soft_wrap=True)
        out.print(f"correlation: {_correlation(fit.half_life)}", soft_wrap=True)
        for stage in ("duplicate", "corrupt", "ordering"):
            if stage in fit.stages:
                out.print(f"{stage}: {_plainly(fit.stages[stage])}")
        low, high = fit.losses.p_loss_interval
        runs = fit.losses.mean_burst_interval
        burst = (
            ""
            if runs is None
            else (f"; mean run {_number(fit.losses.mean_burst)} (95 %: {runs[0]:.4g} to {runs[1]:.4g})")
        )
        out.print(f"loss: {100 * fit.losses.p_loss:.4g} % (95 %: {100 * low:.4g} to {100 * high:.4g}){burst}")


def _why_taken(fit: DirectionFit, wanted: bool) -> str:
    if wanted:
        return "as requested"
    return fit.steady or f"a family must have KS <= {fit.marginal.ks_bound:.4f}"


def _plainly(stage: Any) -> str:
    if not isinstance(stage, dict):
        return str(stage)
    return ", ".join(f"{name} {value:g}" for name, value in stage.items())


def _correlation(half_life: Any) -> str:
    if half_life.seconds is None:
        return f"none: {half_life.why}"
    ends = half_life.interval
    within = "" if ends is None else f" (95 %: {ends[0]:.4g} to {ends[1]:.4g})"
    return f"half-life {half_life.seconds:.4g} s{within}, {100 * half_life.correlated_share:.0f} % of the variance"


def _cells(of: DirectionFigures) -> tuple[str, ...]:
    values = (of.mean_ms, of.p50_ms, of.p99_ms, of.loss_pct, of.mean_burst, of.outage_pct)
    return tuple(_number(value) for value in values)


def _figure(value: float | None, uncertainty_ms: float | None) -> str:
    if uncertainty_ms is None:
        return _number(value)
    remark = "" if is_resolvable(value, uncertainty_ms) else " (not resolvable)"
    return f"{_number(value)} ± {_number(uncertainty_ms)}{remark}"


def _number(value: float | None) -> str:
    return _UNKNOWN if value is None or isnan(value) else f"{value:.4g}"
