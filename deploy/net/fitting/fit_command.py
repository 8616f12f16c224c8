"""Command ``tis net fit``: reads records, fits them, prints the fits and writes a profile."""

import json
import re
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from tis.common.channels import Direction
from tis.common.errors import EXIT_OK, Fault, InputError
from tis.deploy.net.fitting.fit import Ways, cautions, fit_records, plain, profile_of, records, unfitted_lines
from tis.deploy.net.fitting.run_records import RUN_HEADER_FIELDS
from tis.deploy.net.fitting.structure_table import print_structure
from tis.deploy.net.library.profiles import SUFFIXES, dump_profile
from tis.deploy.net.terminal import print_fit
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.messages import print_warnings
from tis.deploy.shell.outputs import check_outputs
from tis.netem.fit.direction import DirectionFit
from tis.netem.fit.marginal import MarginalName


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
