"""Zenoh sessions as the testbed needs them: no scouting, no gossip, dead peers noticed within seconds.

Multicast and gossip stay off, for two sides that find each other by themselves would bypass the emulator.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Literal

import zenoh

from common.endpoint import endpoint_faults
from common.errors import Fault, InputError, PeerError

_LEASE_MS: Final = 2000
_ATTEMPT_MS: Final = 400
_PATIENCE_US: Final = 20_000
_PRIORITIES: Final = (
    "control", "real_time", "interactive_high", "interactive_low", "data_high", "data", "data_low", "background",
)  # fmt: skip
_DEFAULTS: Final[dict[str, Any]] = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "scouting/delay": 0,  # a router would wait half a second for those that scouting might find
    "transport/link/tx/lease": _LEASE_MS,
    "transport/shared_memory/enabled": False,
    "connect/timeout_ms": _ATTEMPT_MS,
    "connect/exit_on_failure": True,
    "connect/retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2},
    # two batches, Zenoh's default, overflow when a few urgent messages come at once; 16 is the most it allows
    "transport/link/tx/queue/size": dict.fromkeys(_PRIORITIES, 16),
    "listen/timeout_ms": 0,
    "listen/exit_on_failure": True,
}
# A side waits this long for a full queue: the default, 1 ms, is less than another process's turn, and what is lost
# there was planned by nobody. netem does not: who does not read must not hold up the others.
_OF_CLIENTS: Final[dict[str, Any]] = {
    "transport/link/tx/queue/congestion_control/drop/wait_before_drop": _PATIENCE_US
}


@dataclass(frozen=True)
class ZenohOptions:
    """Zenoh's own options, as its examples spell them: ``-e -l -c --cfg KEY:VALUE``."""

    connect: Sequence[str] = ()
    listen: Sequence[str] = ()
    config: Path | None = None
    cfg: Sequence[str] = ()


def configure(mode: Literal["client", "peer", "router"], options: ZenohOptions) -> zenoh.Config:
    """Return a configuration; what the user gives overrides the defaults. Raises `InputError`.

    A setting that the user's file leaves at Zenoh's own default gets ours.
    """
    try:
        config = zenoh.Config() if options.config is None else zenoh.Config.from_file(options.config)
    except zenoh.ZError as error:
        raise InputError(Fault("--config", str(options.config), _in_one_line(error))) from None
    untouched = zenoh.Config()
    for key, value in (_DEFAULTS | (_OF_CLIENTS if mode == "client" else {})).items():
        if config.get_json(key) == untouched.get_json(key):
            config.insert_json5(key, json.dumps(value))
    config.insert_json5("mode", json.dumps(mode))
    faults = endpoint_faults("zenoh", {"--connect": options.connect, "--listen": options.listen})
    settings = []
    for kind, endpoints in (("connect", options.connect), ("listen", options.listen)):
        if endpoints and not faults:
            settings.append((f"{kind}/endpoints", json.dumps(list(endpoints))))
    for item in options.cfg:
        key, colon, value = item.partition(":")
        if not colon:
            faults.append(Fault("--cfg", item, "must read KEY:VALUE"))
            continue
        settings.append((key, value))
    for key, value in settings:
        try:
            config.insert_json5(key, value)
        except zenoh.ZError as error:
            faults.append(Fault("zenoh", key, _in_one_line(error), value))
    if faults:
        raise InputError(faults)
    return config


def visitor(endpoint: str, options: ZenohOptions) -> zenoh.Config:
    """Return the configuration of a client of one endpoint, which listens nowhere, whatever a shared file says."""
    cfg = (*options.cfg, "listen/endpoints:[]")
    return configure("client", replace(options, connect=(endpoint,), listen=(), cfg=cfg))


def open_router(config: zenoh.Config, endpoint: str, who: str = "netem") -> zenoh.Session:
    """Open a listening router session; raises `PeerError` when the endpoint cannot be had."""
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        reason = "in use or not of this host" if "listen" in str(error).lower() else _in_one_line(error)
        raise PeerError(Fault(who, endpoint, f"cannot listen here: {reason}")) from None


def open_client(
    config: zenoh.Config, stopped: Callable[[], bool], on_retry: Callable[[], None]
) -> zenoh.Session | None:
    """Open a client session, trying until a router answers; None when ``stopped``. Raises `InputError`.

    A single endless attempt would ignore Ctrl-C, so each lasts less than half a second.
    """
    while not stopped():
        try:
            return zenoh.open(config)
        except zenoh.ZError as error:
            if "Unable to connect" not in str(error):
                raise InputError(Fault("zenoh", "", _in_one_line(error))) from None
            on_retry()
    return None


def bypasses(session: zenoh.Session) -> list[str]:
    """Return what is wrong with a side's place in the network: it must see one router and nothing else."""
    routers, peers = session.info.routers_zid(), session.info.peers_zid()
    faults = []
    if len(routers) != 1:
        faults.append(f"sees {len(routers)} Zenoh routers, must see exactly one, netem's")
    if peers:
        faults.append(f"sees {len(peers)} Zenoh peers, must see none: they would bypass netem")
    return faults


def _in_one_line(error: Exception) -> str:
    return " ".join(str(error).split()).split(" at /")[0]
