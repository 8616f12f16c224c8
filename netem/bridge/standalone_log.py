"""The folder of an emulator without a scenario: its log, and the network beside it."""

from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import yaml

from tis.common.errors import DataError, Fault
from tis.common.runtime.mcap_log import McapLog
from tis.common.runtime.process import command_line
from tis.common.runtime.scenario_files import trace_attachments
from tis.common.runtime.side_log import LOG_VERSION
from tis.common.scenario.network import NetworkPart


def open_log(folder: Path | None, network: NetworkPart, seed: int, keys: Sequence[str]) -> McapLog | None:
    """Open the log, if there is to be one, with the network beside it. Raises `DataError`."""
    if folder is None:
        return None
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(
            Fault(str(folder), "", f"cannot be created: {error.strerror}; give another --run-dir")
        ) from None
    about = {"version": LOG_VERSION, "side": "netem", "mode": "live", "seed": str(seed)}
    about |= {name: version(name) for name in ("tis-testbed", "eclipse-zenoh")}
    about |= {"command": command_line()}
    about |= {"begun": datetime.now(UTC).isoformat(timespec="seconds"), "keys": "\n".join(keys)}
    log = McapLog(folder / "netem.mcap", about | {"profile": network.from_profile or ""})
    content = network_yaml(network).encode()
    _write(folder / "network.yaml", content)  # now, so that it exists however the run ends
    log.attach("network.yaml", content)
    for name, trace in trace_attachments(network).items():
        log.attach(name, trace)
    log.flush()
    return log


def _write(path: Path, content: bytes) -> None:
    partial = path.with_suffix(f"{path.suffix}.part")
    try:
        partial.write_bytes(content)
        partial.replace(path)
    except OSError as error:
        raise DataError(Fault(str(path), "", f"cannot be written: {error.strerror}")) from None


def network_yaml(network: NetworkPart) -> str:
    """Return a network as a file for ``--scenario-network``, with the values of its profile but no defaults."""
    return yaml.safe_dump(network.model_dump(mode="json", exclude_defaults=True), sort_keys=False)
