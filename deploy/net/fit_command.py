"""Command ``tis net fit``: reads records, fits them, prints the fits and writes a profile."""

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.markup import escape

from tis.common.channels import Direction
from tis.common.errors import EXIT_OK, Fault, InputError
from tis.common.runtime.process import command_line
from tis.deploy.net.fit import (
    Ways,
    cautions,
    fit_records,
    plain,
    profile_of,
    records,
    refuse_unfitted,
    unfitted_lines,
)
from tis.deploy.net.profiles import SUFFIXES, dump_profile
from tis.deploy.net.run_records import RUN_HEADER_FIELDS
from tis.deploy.present.numbers import known
from tis.deploy.present.table import PLAIN, Cell, Column, Table
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.guard import check_outputs, print_warnings
from tis.netem.draws.blocks import Floats
from tis.netem.fit.backlogs import MESSAGE_BYTES, Backlogs
from tis.netem.fit.direction import DirectionFit, JointStates
from tis.netem.fit.marginal import MarginalName
from tis.netem.fit.record import MEASURING_ADDS, DirectionRecord

_CANDIDATES: Final = (
    Column("distribution", words=True, wraps=True),
    Column("KS", wraps=True, show="{:.4f}".format),
    Column("BIC", wraps=True, show="{:.0f}".format),
    Column("parameters", words=True, wraps=True),
)


def print_fit(
    fits: Mapping[Direction, DirectionFit], of: Mapping[Direction, DirectionRecord], out: Console,
    wanted: bool = False,
) -> None:  # fmt: skip
    """Print the candidates and the chosen fit of each direction."""
    seen: list[DirectionFit] = []
    for direction, fit in fits.items():
        if fit in seen:
            continue
        seen.append(fit)
        name = direction if sum(other is fit for other in fits.values()) == 1 else "both ways"
        key = f", key {escape(of[direction].key)}" if of[direction].key else ""
        out.print(f"[bold]{name}[/bold]{key}: {fit.n} messages in {fit.duration_s:.3f} s, {fit.n_lost} lost")
        rows = []
        for candidate in fit.marginal.candidates:
            taken = candidate.name == fit.marginal.chosen
            parameters = {key: value for key, value in candidate.stage.items() if key not in ("kind", "points")}
            if "points" in candidate.stage:
                parameters["points"] = len(candidate.stage["points"])
            name_and_mark = f"{candidate.name}{' <-' if taken else ''}"
            words = ", ".join(f"{key} {value}" for key, value in parameters.items())
            rows.append((name_and_mark, candidate.ks, candidate.bic, words))
        out.print(Table("", _CANDIDATES, rows).terminal(PLAIN))
        for left_out in fit.left_out:
            out.print(escape(f"left out: {left_out}"), soft_wrap=True)
        out.print(f"taken: {fit.marginal.chosen} ({_why_taken(fit, wanted)})", soft_wrap=True)
        out.print(f"correlation: {fit.half_life.words}", soft_wrap=True)
        for stage in ("duplicate", "corrupt", "ordering"):
            if stage in fit.stages:
                out.print(f"{stage}: {_plainly(fit.stages[stage])}")
        low, high = fit.losses.p_loss_interval
        runs = fit.losses.mean_burst_interval
        burst = (
            ""
            if runs is None
            else (f"; mean run {known(fit.losses.mean_burst)} (95 %: {runs[0]:.4g} to {runs[1]:.4g})")
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


def print_structure(fits: Mapping[Direction, DirectionFit], out: Console) -> None:
    """Print what a fit has beside its pipeline, and how far its replays reproduce the record; each fit once."""
    for fit in {id(fit): fit for fit in fits.values()}.values():
        if fit.outages.process is not None:
            _print_outages("outages", "losses", fit.outages.process, fit.outages.lengths_s, out)
        if fit.stalls is not None:
            _print_outages("stalls", "delays", fit.stalls.process, fit.stalls.lengths_s, out)
        if fit.backlogs is not None:
            _print_backlogs(fit.backlogs, out)
        if fit.steps is not None:
            values_ms, every_s = fit.steps.values_ms, fit.steps.process["every_s"]
            words = (
                f"{len(values_ms)} values of 0 to {values_ms.max():.4g} ms, taken out before the delays were fitted"
            )
            out.print(f"steps: every {every_s:g} s, {words}", soft_wrap=True)
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
    rows = []
    for one in fit.closures:
        closes = "yes" if one.closes else Cell("no", "bold red")
        rows.append((one.name, f"{one.record:.4g}", f"{one.mean:.4g}", f"{one.low:.4g} to {one.high:.4g}", closes))
    n = f"{fit.n_replays} replays"
    columns = (n, "record", "mean", "95 % of further ones", Column("closes", words=True))
    out.print(Table("", columns, rows).terminal(PLAIN))


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
    key: str | None = None,
) -> int:
    """Fit the record in ``source`` and write a profile to ``target``; raises `DataError`, `InputError`."""
    check_outputs(target)
    if target is not None and target.suffix not in SUFFIXES:
        raise InputError(Fault("tis net fit", "--out", f"must end in {SUFFIXES[0]}", str(target)))
    of = records(source, ways, received, key)
    fits, unfitted = fit_records(of, wanted, n_replays)
    refuse_unfitted(source, unfitted)
    gaps = dict.fromkeys(record.trace.about["lack"] for record in of.values() if "lack" in record.trace.about)
    sent = dict.fromkeys(record.trace.about["sent"] for record in of.values() if "sent" in record.trace.about)
    print_warnings(err, *(f"{source}: {gap}" for gap in (*gaps, *sent)), *unfitted_lines(unfitted))
    profile = profile_of(name or _name_for(target or source), of, fits, unfitted)
    replaced = " (replaced)" if target is not None and target.exists() else ""
    if target is not None:
        folder.write(target, dump_profile(profile))
    print_warnings(err, *_cautions(fits), *_of_the_machine(fits, of))
    if as_json:
        print(json.dumps({"profile": profile.name, "fits": plain(fits)}, indent=1))  # noqa: T201
        return EXIT_OK
    print_fit(fits, of, out, wanted is not None)
    print_structure(fits, out)
    for direction in fits if source.is_dir() else ():
        about = of[direction].trace.about
        text = "; ".join(about[name] for name in RUN_HEADER_FIELDS if name in about)
        out.print(escape(f"{direction}: {text}"), soft_wrap=True)
    if target is not None:
        netem = command_line(["netem", "--profile", str(target)])
        use = f"{netem} ..., or in a scenario network: {{profile: {target}}}"
        out.print(escape(f"profile {profile.name} in {target}{replaced}: {use}"), soft_wrap=True)
    return EXIT_OK


def _cautions(fits: dict[Direction, DirectionFit]) -> list[str]:
    """Return the cautions of each fit, once where both directions share it."""
    shared = len(fits) > 1 and len({id(fit) for fit in fits.values()}) == 1
    each = {"both ways": fits["forward"]} if shared else dict(fits)
    return [f"{where}: {caution}" for where, fit in each.items() for caution in cautions(fit)]


def _of_the_machine(fits: Mapping[Direction, DirectionFit], of: Mapping[Direction, DirectionRecord]) -> list[str]:
    """Return a caution where delays that change with time were fitted, and the machine measured added such itself."""
    found = {
        f"{added} ms were added by measuring: stalls, queues and states of such a size may be the machine's, not the "
        "network's"
        for direction, fit in fits.items()
        if (added := of[direction].trace.about.get(MEASURING_ADDS)) and (fit.stalls or fit.backlogs or fit.states)
    }
    return sorted(found)


def _name_for(path: Path) -> str:
    return re.sub(r"[^A-Za-z0-9_-]+", "_", path.resolve().stem).strip("_-")[:64] or "fitted"
