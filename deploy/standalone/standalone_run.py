"""Run of a standalone netem: one log that also holds the requested network and the forwarded keys."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from pydantic import ValidationError

from tis.common.errors import DataError, Fault
from tis.common.records import FATES
from tis.common.runtime.scenario_files import load_traces
from tis.common.scenario.faults import faults
from tis.common.scenario.network import NetworkPart
from tis.common.yaml_text import load_yaml
from tis.deploy.logs.log_paths import log_file
from tis.deploy.logs.read.load import RunLogs, load_side
from tis.deploy.logs.read.side_log import Packets, SideLog
from tis.deploy.report.subjects.network.requested import StandaloneNetwork
from tis.deploy.shell import run_dir as folder
from tis.netem.bridge.keys import crossing_keys
from tis.netem.expected.synopsis import synopsis

NETWORK_FILE: Final = folder.NETWORK_FILE
LOG: Final = "netem.mcap"
_OTHER_LOGS: Final = ("surgeon.mcap", "patient.mcap")
_SEPARATOR: Final = "\n"
_VERSIONS: Final = ("tis-testbed", "eclipse-zenoh")


@dataclass(frozen=True)
class StandaloneRun:
    """Loaded folder of a standalone netem, in which messages of all applications count."""

    logs: RunLogs
    request: StandaloneNetwork
    about: Mapping[str, str]
    """Metadata of the log: version of tis, time of its begin, profile."""

    @property
    def versions(self) -> dict[str, str]:
        """Return the versions of the run, as far as the log holds them."""
        return {name: self.about[name] for name in _VERSIONS if name in self.about}

    @property
    def log(self) -> SideLog:
        """Return netem's log."""
        return self.logs.sides["netem"]


def is_standalone(run_dir: Path) -> bool:
    """Tell whether a folder holds the log of a netem without a scenario and no log of another side."""
    others = (folder.SCENARIO_FILE, *_OTHER_LOGS)
    path = log_file(run_dir, "netem")
    if not path.is_file() or any((run_dir / name).exists() for name in others):
        return False
    if (run_dir / NETWORK_FILE).is_file():
        return True
    try:
        return NETWORK_FILE in load_side(path, "netem").attachments
    except DataError:
        return False


def load_standalone(run_dir: Path) -> StandaloneRun:
    """Load the folder of a standalone netem, a damaged log as far as it is readable; raises `DataError`."""
    log = load_side(log_file(run_dir, "netem"), "netem")
    logs = RunLogs(run_dir, {"netem": replace(log, packets=_without_foreign_mark(log.packets))})
    return StandaloneRun(logs, _recorded_network(run_dir, log), log.metadata)


def network_lines(run: StandaloneRun) -> list[str]:
    """Return the synopsis of the network as printed at the start; empty when a trace is missing."""
    try:
        return synopsis(run.request.network, load_traces(run.request.network, run.log.attachments))
    except DataError:
        return []


def _without_foreign_mark(packets: Packets) -> Packets:
    """Return the packets with ``foreign`` cleared: without the testbed's own messages the mark has no meaning.

    The mark stays on keys with both kinds, where netem's numbers and those of headers (as of the probe) are two
    separate series.
    """
    marks = {place: frame.foreign for place, frame in packets.get(FATES, {}).items()}
    both = {place for place, flags in marks.items() if flags.any() and not flags.all()}
    return {
        topic: {
            place: frame if place in both else frame.with_columns(foreign=np.zeros(len(frame), dtype=np.bool_))
            for place, frame in of_topic.items()
        }
        for topic, of_topic in packets.items()
    }


def _recorded_network(run_dir: Path, log: SideLog) -> StandaloneNetwork:
    content = log.attachments.get(NETWORK_FILE)
    where = str(run_dir / LOG)
    if content is None:
        raise DataError(Fault(where, "", f"holds no {NETWORK_FILE}: its beginning is lost"))
    try:
        network = NetworkPart.model_validate(load_yaml(content.decode(), where))
    except ValidationError as error:
        raise DataError(faults(error, NetworkPart, where)) from None
    keys = tuple(log.metadata.get("keys", "**").split(_SEPARATOR))
    return StandaloneNetwork(network, keys, crossing_keys(keys).all, int(log.metadata.get("seed", 0)))
