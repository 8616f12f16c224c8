"""Terminal output of a fit's outages, states and replays."""

from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from tis.common.channels import Direction
from tis.netem.draws.blocks import Floats
from tis.netem.fit.backlogs import MESSAGE_BYTES, Backlogs
from tis.netem.fit.direction import DirectionFit
from tis.netem.fit.joint_states import JointStates


def print_structure(fits: Mapping[Direction, DirectionFit], out: Console) -> None:
    """Print what a fit has beside its pipeline, and how far its replays reproduce the record; each fit once."""
    for fit in {id(fit): fit for fit in fits.values()}.values():
        if fit.outages.process is not None:
            _print_outages("outages", "losses", fit.outages.process, fit.outages.lengths_s, out)
        if fit.stalls is not None:
            _print_outages("stalls", "delays", fit.stalls.process, fit.stalls.lengths_s, out)
        if fit.backlogs is not None:
            _print_backlogs(fit.backlogs, out)
        if fit.states is not None:
            _print_states(fit.states, out)
        if fit.closures:
            _print_replays(fit, out)


def _print_outages(name: str, before: str, process: Mapping[str, Any], lengths_s: Floats, out: Console) -> None:
    parameters = ", ".join(f"{name} {_plain(value)}" for name, value in process.items())
    out.print(
        f"{name}: {len(lengths_s)}, of {lengths_s.min():.4g} to {lengths_s.max():.4g} s, taken out before the "
        f"{before} were fitted: {parameters}",
        soft_wrap=True,
    )


def _print_backlogs(backlogs: Backlogs, out: Console) -> None:
    parameters = ", ".join(f"{name} {_plain(value)}" for name, value in backlogs.stage.items())
    out.print(
        f"backlogs: {backlogs.n}, up to {backlogs.highest_ms:.4g} ms, growing by {1000 * backlogs.rising:.4g} and "
        f"shrinking by {1000 * backlogs.falling:.4g} ms a second: {parameters}; the rate holds for messages of "
        f"{MESSAGE_BYTES} bytes",
        soft_wrap=True,
    )


def _print_states(states: JointStates, out: Console) -> None:
    out.print(f"states: {states.note}", soft_wrap=True)
    for state in states.states:
        change = {
            name: f"{len(value['points'])} quantiles" if "points" in str(value) else _plain(value)
            for name, value in state.change.items()
        }
        words = ", ".join(f"{name} {value}" for name, value in change.items()) or "the pipeline above"
        length_s = state.duration.get("for_s", state.duration.get("mean_s"))
        out.print(escape(f"  {state.name}, {length_s:g} s: {words}"), soft_wrap=True)


def _print_replays(fit: DirectionFit, out: Console) -> None:
    table = Table(box=None, padding=(0, 2, 0, 0))
    table.add_column(f"{fit.n_replays} replays", no_wrap=True)
    for heading in ("record", "mean", "middle 95 %"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("closes", no_wrap=True)
    for one in fit.closures:
        middle = f"{one.low:.4g} to {one.high:.4g}"
        table.add_row(
            one.name, f"{one.record:.4g}", f"{one.mean:.4g}", middle, "yes" if one.closes else "[bold red]no[/]"
        )
    out.print(table)


def _plain(value: object) -> str:
    if isinstance(value, dict):
        return "(" + ", ".join(f"{name} {_plain(item)}" for name, item in value.items()) + ")"
    return f"{value:g}" if isinstance(value, float) else str(value)
