"""Command ``tis net fit``: reads records, fits them, prints the fits and writes a profile."""

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from tis.common.channels import Direction
from tis.common.errors import EXIT_OK, Fault, InputError
from tis.deploy.net.fitting.fit import Ways, cautions, fit_records, plain, profile_of, records, unfitted_lines
from tis.deploy.net.fitting.run_records import RUN_HEADER_FIELDS
from tis.deploy.net.library.profiles import SUFFIXES, dump_profile
from tis.deploy.net.terminal import print_fit
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.early_checks import check_outputs
from tis.deploy.shell.guard import print_warnings
from tis.netem.draws.blocks import Floats
from tis.netem.fit.backlogs import MESSAGE_BYTES, Backlogs
from tis.netem.fit.direction import DirectionFit
from tis.netem.fit.joint_states import JointStates
from tis.netem.fit.marginal import MarginalName


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


def fit_and_print(
    source: Path,
    target: Path | None,
    name: str | None,
    ways: Ways,
    wanted: MarginalName | None,
    out: Console,
    err: Console,
    as_json: bool,
    n_replays: int,
    received: Path | None = None,
) -> int:
    """Fit the record in ``source`` and write a profile to ``target``; raises `DataError`, `InputError`."""
    check_outputs(target)
    if target is not None and target.suffix not in SUFFIXES:
        raise InputError(Fault("tis net fit", "--out", f"must end in {SUFFIXES[0]}", str(target)))
    of = records(source, ways, received)
    fits, unfitted = fit_records(of, wanted, n_replays)
    gaps = dict.fromkeys(record.trace.about["lack"] for record in of.values() if "lack" in record.trace.about)
    print_warnings(err, *(f"{source}: {gap}" for gap in gaps), *unfitted_lines(unfitted))
    profile = profile_of(name or _name_for(target or source), of, fits, unfitted)
    replaced = " (replaced)" if target is not None and target.exists() else ""
    if target is not None:
        folder.write(target, dump_profile(profile))
    print_warnings(err, *_cautions(fits))
    if as_json:
        print(json.dumps({"profile": profile.name, "fits": plain(fits)}, indent=1))  # noqa: T201
        return EXIT_OK
    print_fit(fits, out, wanted is not None)
    print_structure(fits, out)
    for direction in fits if source.is_dir() else ():
        about = of[direction].trace.about
        text = "; ".join(about[name] for name in RUN_HEADER_FIELDS if name in about)
        out.print(escape(f"{direction}: {text}"), soft_wrap=True)
    if target is not None:
        use = f"tis netem --profile {target} ..., or in a scenario network: {{profile: {target}}}"
        out.print(escape(f"profile {profile.name} in {target}{replaced}: {use}"), soft_wrap=True)
    return EXIT_OK


def _cautions(fits: dict[Direction, DirectionFit]) -> list[str]:
    """Return the cautions of each fit, once where both directions share it."""
    shared = len(fits) > 1 and len({id(fit) for fit in fits.values()}) == 1
    each = {"both ways": fits["forward"]} if shared else dict(fits)
    return [f"{where}: {caution}" for where, fit in each.items() for caution in cautions(fit)]


def _name_for(path: Path) -> str:
    return re.sub(r"[^A-Za-z0-9_-]+", "_", path.resolve().stem).strip("_-")[:64] or "fitted"
