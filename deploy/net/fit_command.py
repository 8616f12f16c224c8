"""What ``tis net fit`` does: read, fit, print, write a profile."""

import json
import re
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from common.errors import EXIT_OK, DataError, Fault
from deploy import run_dir as folder
from deploy.net.fit import Ways, fit_records, plain, profile_of, records
from deploy.net.profiles import dump_profile
from deploy.net.tables import print_fit
from netem.fit.marginal import MarginalName


def fit_and_print(
    source: Path,
    target: Path | None,
    name: str | None,
    ways: Ways,
    wanted: MarginalName | None,
    out: Console,
    as_json: bool,
) -> int:
    """Fit what ``source`` holds, and write a profile to ``target``; raises `DataError`, `InputError`."""
    if target is not None and not target.parent.is_dir():
        raise DataError(Fault(str(target), "", "must lie in a folder that exists"))
    traces = records(source, ways)
    fits = fit_records(traces, wanted)
    profile = profile_of(name or _name_for(target or source), traces, fits)
    if target is not None:
        folder.write(target, dump_profile(profile))
    if as_json:
        print(json.dumps({"profile": profile.name, "fits": plain(fits)}, indent=1))  # noqa: T201
        return EXIT_OK
    print_fit(fits, out)
    if target is not None:
        out.print(escape(f"profile {profile.name} in {target}: network: {{profile: {target}}}"), soft_wrap=True)
    return EXIT_OK


def _name_for(path: Path) -> str:
    return re.sub(r"[^A-Za-z0-9_-]+", "_", path.resolve().stem).strip("_-")[:64] or "fitted"
