"""What a standalone netem left: one log, with the network that was asked for and the keys that crossed in it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydantic import ValidationError

from common.errors import DataError, Fault
from common.records import FATES
from common.runtime.trace_files import load_traces
from common.scenario.faults import faults
from common.scenario.network import NetworkPart, Rule
from common.scenario.yaml_text import load_yaml
from deploy.logs.choice import log_file
from deploy.logs.read.compact_ints import CompactInts
from deploy.logs.read.load import RunLogs, load_side
from deploy.logs.read.side_columns import SideLog
from deploy.shell import run_dir as folder
from netem.bridge.keys import crossing_keys
from netem.expected.synopsis import synopsis

NETWORK_FILE: Final = folder.NETWORK_FILE
LOG: Final = "netem.mcap"
_OTHER_LOGS: Final = ("surgeon.mcap", "patient.mcap")
_SEPARATOR: Final = "\n"
_VERSIONS: Final = ("tis-testbed", "eclipse-zenoh")


@dataclass(frozen=True)
class StandaloneNetwork:
    """What decided such a run; to reports it is what a scenario is to a run of the testbed."""

    network: NetworkPart
    keys: tuple[str, ...]
    seed: int
    name: str = "netem"
    session: str = ""

    @property
    def impaired_keys(self) -> tuple[str, ...]:
        """Return the key expressions that get the network's own pipelines where no rule names another."""
        return crossing_keys(self.keys).all

    def generated_rules(self) -> tuple[Rule, ...]:
        """Return no rules: nobody but the user wrote any."""
        return ()


@dataclass(frozen=True)
class StandaloneRun:
    """A folder that is read: all messages count, whoever's they are."""

    logs: RunLogs
    asked: StandaloneNetwork
    about: Mapping[str, str]
    """The log's own words: version of tis, when it began, profile."""

    @property
    def versions(self) -> dict[str, str]:
        """Return the versions that ran, as far as the log names them."""
        return {name: self.about[name] for name in _VERSIONS if name in self.about}

    @property
    def log(self) -> SideLog:
        """Return netem's log."""
        return self.logs.sides["netem"]


def is_standalone(run_dir: Path) -> bool:
    """Tell whether a folder holds the log of a netem without a scenario, and no other side's."""
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
    """Read the folder of a standalone netem, a damaged log as far as it goes; raises `DataError`."""
    log = load_side(log_file(run_dir, "netem"), "netem")
    logs = RunLogs(run_dir, {"netem": replace(log, batches=_as_ours(log.batches))})
    return StandaloneRun(logs, _asked(run_dir, log), log.metadata)


def network_lines(run: StandaloneRun) -> list[str]:
    """Return what was asked of each direction, as it was said at the start; nothing where a trace is missing."""
    try:
        return synopsis(run.asked.network, load_traces(run.asked.network, run.log.attachments))
    except DataError:
        return []


def _as_ours(batches: Mapping[str, list[dict[str, Any]]]) -> dict[str, list[dict[str, Any]]]:
    """Return the batches without the mark of the foreign: where nobody is the testbed, nobody is a stranger.

    It stays where a key carries both: then netem's numbers and those of the headers, as the probe's, are two series.
    """
    marks = {(one["direction"], one["key"]): one["foreign"].values() for one in batches.get(FATES, ())}
    both = {place for place, foreign in marks.items() if foreign.any() and not foreign.all()}

    def nobody(batch: Mapping[str, Any]) -> CompactInts:
        if (batch["direction"], batch["key"]) in both:
            marked: CompactInts = batch["foreign"]
            return marked
        column = CompactInts()
        column.extend(np.zeros(len(batch["seq"]), dtype=np.int64))
        return column

    return {topic: [{**batch, "foreign": nobody(batch)} for batch in rows] for topic, rows in batches.items()}


def _asked(run_dir: Path, log: SideLog) -> StandaloneNetwork:
    content = log.attachments.get(NETWORK_FILE)
    where = str(run_dir / LOG)
    if content is None:
        raise DataError(Fault(where, "", f"holds no {NETWORK_FILE}: its beginning is lost"))
    try:
        network = NetworkPart.model_validate(load_yaml(content.decode(), where))
    except ValidationError as error:
        raise DataError(faults(error, NetworkPart, where)) from None
    keys = tuple(log.metadata.get("keys", "**").split(_SEPARATOR))
    return StandaloneNetwork(network, keys, int(log.metadata.get("seed", 0)))
