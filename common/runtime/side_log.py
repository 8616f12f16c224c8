"""The log that a side's process writes: a new one, or the next part of its own (`tis.common.runtime.log_parts`)."""

import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from tis.common import messages
from tis.common.channels import Side
from tis.common.errors import DataError, Fault, PeerError
from tis.common.runtime.control import boot_digest
from tis.common.runtime.log_parts import EarlierPart, last_part, n_parts, part_name
from tis.common.runtime.mcap_log import McapLog, prepare_schemas
from tis.common.runtime.run_folders import RUNS, latest_folders, run_folder
from tis.common.runtime.zenoh_session import ZenohOptions
from tis.common.scenario import Scenario
from tis.common.scenario import reading as scenario_io
from tis.common.topics import RECORD_MODULES

LOG_VERSION: Final = "1"


@dataclass(frozen=True)
class SideOptions:
    """Options of a side's process, beside its scenario.

    ``run_dir`` None: a new folder below runs/, or that of the run that this side was killed in.
    ``witness``: another program is this side, and this process only writes its log.
    ``device``: the kind of device that is started beside the surgeon.
    """

    run_dir: Path | None
    zenoh: ZenohOptions = field(default_factory=ZenohOptions)
    wait_s: float | None = None
    alone: bool = True
    witness: bool = False
    device: str | None = None


def earlier_part(options: SideOptions, scenario: Scenario, side: Side) -> EarlierPart | None:
    """Return the part of this side's log that a restarted side continues; None without one, or where its run is over.

    A log of an earlier run stays where it is, and `open_log` refuses to write over it.
    """
    digest, now_ns = scenario_io.digest(scenario), time.time_ns()
    if options.run_dir is not None:
        found = last_part(options.run_dir, side)
        return found if found is not None and found.is_under_way(digest, scenario.end_ns, now_ns) else None
    for folder in latest_folders(RUNS, scenario.name):
        found = last_part(folder, side)
        if found is not None and found.was_cut and found.is_under_way(digest, scenario.end_ns, now_ns):
            return found
    return None


@contextmanager
def open_log(
    options: SideOptions, scenario: Scenario, side: Side, earlier: EarlierPart | None = None
) -> Iterator[McapLog]:
    """Create this side's log in the run folder, or the next part after ``earlier``; raises `DataError`.

    Of a run that did not begin neither the log is kept nor a folder that was made for it.
    """
    if earlier is not None:
        folder, number = earlier.path.parent, n_parts(earlier.path.parent, side) + 1
    else:
        folder, number = options.run_dir or run_folder(RUNS, scenario.name), 1
    made = [place for place in (folder, *folder.parents) if not place.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        rule = f"cannot be created: {error.strerror}; give another --run-dir"
        raise DataError(Fault(str(folder), "", rule)) from None
    metadata = {
        "version": LOG_VERSION,
        "side": side,
        "scenario": scenario.name,
        "digest": scenario_io.digest(scenario),
        "mode": "live",
    }
    for module in (messages, *RECORD_MODULES):
        prepare_schemas(module)
    try:
        with McapLog(folder / part_name(side, number), metadata, keep_void=False) as log:
            log.attach("scenario.yaml", scenario_io.dump_scenario(scenario).encode())
            yield log
    finally:
        with suppress(OSError):  # it holds a log
            for place in made:
                place.rmdir()


def continued(
    log: McapLog, options: SideOptions, scenario: Scenario, side: Side, earlier: EarlierPart | None, run_id: int
) -> EarlierPart | None:
    """Return the part that ``log`` continues in the run ``run_id``, None where it begins anew.

    The log of another run moves to a new folder, or is refused by a `PeerError` when the user named the folder.
    """
    why = None if earlier is None else earlier.why_not_continued(run_id, boot_digest())
    if why is None:
        return earlier
    if options.run_dir is not None:
        raise PeerError(Fault(side, "--run-dir", f"{why}: give another --run-dir"))
    log.move(run_folder(RUNS, scenario.name) / part_name(side, 1))
    return None
