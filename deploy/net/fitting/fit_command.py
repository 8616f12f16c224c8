"""What ``tis net fit`` does: read, fit, print, write a profile."""

import json
import re
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from common.errors import EXIT_OK, DataError, Fault, InputError
from deploy.net.fitting.fit import Ways, cautions, fit_records, plain, profile_of, records, unfitted_lines
from deploy.net.fitting.run_records import RUN_HEADER_FIELDS
from deploy.net.library.profiles import SUFFIXES, dump_profile
from deploy.net.terminal import print_fit
from deploy.shell import run_dir as folder
from netem.fit.marginal import MarginalName


def fit_and_print(
    source: Path,
    target: Path | None,
    name: str | None,
    ways: Ways,
    wanted: MarginalName | None,
    out: Console,
    err: Console,
    as_json: bool,
) -> int:
    """Fit what ``source`` holds, and write a profile to ``target``; raises `DataError`, `InputError`."""
    if target is not None and not target.parent.is_dir():
        raise DataError(Fault(str(target), "", "must lie in a folder that exists"))
    if target is not None and target.suffix not in SUFFIXES:
        raise InputError(Fault("tis net fit", "--out", f"must end in {SUFFIXES[0]}", str(target)))
    of = records(source, ways)
    fits, unfitted = fit_records(of, wanted)
    abouts = [record.trace.about for record in of.values()]
    lacks = [f"{source}: {lack}" for lack in dict.fromkeys(about["lack"] for about in abouts if "lack" in about)]
    for warning in (*lacks, *unfitted_lines(unfitted)):
        err.print(escape(f"tis: warning: {warning}"), style="yellow", soft_wrap=True)
    profile = profile_of(name or _name_for(target or source), of, fits, unfitted)
    replaced = " (replaced)" if target is not None and target.exists() else ""
    if target is not None:
        folder.write(target, dump_profile(profile))
    for direction, fit in fits.items():
        where = "both ways" if all(other is fit for other in fits.values()) and len(fits) > 1 else direction
        if where == direction or direction == "forward":
            for caution in cautions(fit):
                err.print(escape(f"tis: warning: {where}: {caution}"), soft_wrap=True)
    if as_json:
        print(json.dumps({"profile": profile.name, "fits": plain(fits)}, indent=1))  # noqa: T201
        return EXIT_OK
    print_fit(fits, out, wanted is not None)
    for direction, record in of.items():
        said = [record.trace.about[name] for name in RUN_HEADER_FIELDS if name in record.trace.about]
        if direction in fits and source.is_dir():
            out.print(escape(f"{direction}: {'; '.join(said)}"), soft_wrap=True)
    if target is not None:
        use = f"tis netem --profile {target} ..., or in a scenario network: {{profile: {target}}}"
        out.print(escape(f"profile {profile.name} in {target}{replaced}: {use}"), soft_wrap=True)
    return EXIT_OK


def _name_for(path: Path) -> str:
    return re.sub(r"[^A-Za-z0-9_-]+", "_", path.resolve().stem).strip("_-")[:64] or "fitted"
