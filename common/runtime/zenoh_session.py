"""Zenoh sessions of the testbed: no scouting, no word to gossip, dead peers detected within seconds.

Multicast and gossip are off, since two sides that discover each other would bypass the emulator.
"""

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Literal

import zenoh

from tis.common.errors import Fault, InputError, PeerError
from tis.common.zenoh_syntax import endpoint_faults, is_local, is_tls

_LEASE: Final = "transport/link/tx/lease"
_LEASE_MS: Final = 2000
_RECEIVE_BYTES: Final = ("transport/link/tcp/so_rcvbuf", "transport/link/tls/so_rcvbuf")
_AFTER_TIMEOUT_S: Final = 5
_ATTEMPT_MS: Final = 400
_PATIENCE_US: Final = 20_000
_PRIORITIES: Final = (
    "control", "real_time", "interactive_high", "interactive_low", "data_high", "data", "data_low", "background",
)  # fmt: skip
_DEFAULTS: Final[dict[str, Any]] = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "scouting/delay": 0,  # a router would wait half a second for the results of scouting
    _LEASE: _LEASE_MS,
    "transport/shared_memory/enabled": False,
    "connect/timeout_ms": _ATTEMPT_MS,
    "connect/exit_on_failure": True,
    "connect/retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2},
    # Two batches, Zenoh's default, overflow when a few urgent messages come at once; 16 is its maximum.
    "transport/link/tx/queue/size": dict.fromkeys(_PRIORITIES, 16),
    # A full queue is waited for this long: the default, 1 ms, is shorter than a scheduler's time slice, and losses
    # here would be unplanned. A slow reader holds the others up once for each congestion: further messages to it
    # are dropped without a wait until its queue has room again.
    "transport/link/tx/queue/congestion_control/drop/wait_before_drop": _PATIENCE_US,
    "listen/timeout_ms": 0,
    "listen/exit_on_failure": True,
}

_GOSSIP: Final = "scouting/gossip"
_NOBODY: Final[dict[str, list[str]]] = {"router": [], "peer": []}
_HEARS: Final[dict[str, Any]] = {
    "scouting/gossip/enabled": True,
    "scouting/gossip/target": _NOBODY,
    "scouting/gossip/autoconnect": _NOBODY,
}
"""A router hears what peers tell of their links, tells nobody anything and connects to nobody for it."""


@dataclass(frozen=True)
class ZenohOptions:
    """Zenoh's own options, as its examples spell them: ``-e -l -c --cfg KEY:VALUE``."""

    connect: Sequence[str] = ()
    listen: Sequence[str] = ()
    config: Path | None = None
    cfg: Sequence[str] = ()
    insecure: bool = False
    """Whether routers may listen beyond loopback although anybody may connect."""
    lease_ms: int = _LEASE_MS
    """How long a silent connection counts as alive, unless the user's settings say otherwise."""
    receive_bytes: int | None = None
    """What the system may keep of a connection before it is read, unless the user's settings say otherwise."""
    credentials: Mapping[str, Any] = field(default_factory=dict, repr=False)
    """Proof of this program's name, and what its routers ask of others (`tis.common.runtime.credentials`)."""


def configure(mode: Literal["client", "peer", "router"], options: ZenohOptions) -> zenoh.Config:
    """Return a configuration; the user's settings override the defaults. Raises `InputError`.

    A setting that the user's file leaves at Zenoh's default gets the testbed's.
    """
    try:
        config = zenoh.Config() if options.config is None else zenoh.Config.from_file(options.config)
    except zenoh.ZError as error:
        raise InputError(Fault("--config", str(options.config), _as_line(error))) from None
    # The testbed's defaults, only where the user's file has not changed Zenoh's.
    untouched = zenoh.Config()
    bounds = {} if options.receive_bytes is None else dict.fromkeys(_RECEIVE_BYTES, options.receive_bytes)
    hears = _HEARS if mode == "router" and not _sets_gossip(config, untouched, options) else {}
    for key, value in (_DEFAULTS | hears | {_LEASE: options.lease_ms} | bounds).items():
        if config.get_json(key) == untouched.get_json(key):
            config.insert_json5(key, json.dumps(value))
    config.insert_json5("mode", json.dumps(mode))
    settings, faults = _settings(options)
    for key, value in settings:
        try:
            config.insert_json5(key, value)
        except zenoh.ZError as error:
            faults.append(Fault("zenoh", key, _as_line(error), value))
    for key, value in options.credentials.items():  # last: no setting of the user weakens the scenario's security
        config.insert_json5(key, json.dumps(value))
    if not options.insecure:
        faults += _exposed(config)
    if faults:
        raise InputError(faults)
    return config


def _sets_gossip(config: zenoh.Config, untouched: zenoh.Config, options: ZenohOptions) -> bool:
    """Tell whether the user has said anything of gossip, by file or option."""
    of_file = config.get_json(_GOSSIP) != untouched.get_json(_GOSSIP)
    return of_file or any(item.startswith((_GOSSIP, "scouting:")) for item in options.cfg)


def _exposed(config: zenoh.Config) -> list[Fault]:
    """Return the faults of listeners that other hosts reach although nobody must prove who he is.

    Clients' certificates and users count as proof, also those of the user's own configuration. TLS alone does not: it
    proves who the server is.
    """
    mode, listen = (json.loads(config.get_json(key)) for key in ("mode", "listen/endpoints"))
    if mode == "client":
        return []
    if isinstance(listen, dict):  # one list for each mode
        listen = listen.get(mode) or ()
    if _has_users(config):
        return []
    is_mutual = config.get_json("transport/link/tls/enable_mtls") == "true"
    rule = (
        "must be on loopback without clients' certificates (mTLS) or passwords, unless --insecure says that anybody "
        "may connect"
    )
    return [
        Fault("zenoh", "--listen", rule, one)
        for one in map(str, listen)
        if not (is_local(one) or (is_mutual and is_tls(one)))
    ]


def _has_users(config: zenoh.Config) -> bool:
    """Tell whether only users with a password may connect: Zenoh lets anybody in whose dictionary names nobody."""
    name = json.loads(config.get_json("transport/auth/usrpwd/dictionary_file"))
    if name is None:
        return False
    try:
        lines = Path(name).read_text("utf-8", "replace").splitlines()
    except OSError:
        return False
    return any(all(part.strip() for part in line.partition(":")) for line in lines)


def _settings(options: ZenohOptions) -> tuple[list[tuple[str, str]], list[Fault]]:
    """Return the options as pairs of key and JSON5 value, and the faults of malformed ones."""
    faults = endpoint_faults("zenoh", {"--connect": options.connect, "--listen": options.listen})
    settings = []
    for kind, endpoints in (("connect", options.connect), ("listen", options.listen)):
        if endpoints and not faults:
            settings.append((f"{kind}/endpoints", json.dumps(list(endpoints))))
    for item in options.cfg:
        key, colon, value = item.partition(":")
        if colon:
            settings.append((key, value))
        else:
            faults.append(Fault("--cfg", item, "must read KEY:VALUE"))
    return settings, faults


def lease_ms(peer_timeout_s: float) -> int:
    """Return the lease of a run's sessions: a silent side is judged by its beats before Zenoh drops it."""
    return int(1000 * (peer_timeout_s + _AFTER_TIMEOUT_S))


def visitor(endpoint: str, options: ZenohOptions) -> zenoh.Config:
    """Return the configuration of a client of one endpoint that listens nowhere, even if a shared file says so."""
    cfg = (*options.cfg, "listen/endpoints:[]")
    return configure("client", replace(options, connect=(endpoint,), listen=(), cfg=cfg))


def open_router(config: zenoh.Config, endpoint: str, who: str = "netem") -> zenoh.Session:
    """Open a listening router session; raises `PeerError` when the endpoint is not available."""
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        words = str(error).lower()
        is_taken = "listen" in words or "deadline" in words  # the latter where there are spares
        reason = "in use or not of this host" if is_taken else _as_line(error)
        raise PeerError(Fault(who, endpoint, f"cannot listen here: {reason}")) from None


def open_client(
    config: zenoh.Config, stopped: Callable[[], bool], on_retry: Callable[[], None]
) -> zenoh.Session | None:
    """Open a client session, retrying until a router answers; None when ``stopped``. Raises `InputError`.

    Each attempt lasts less than half a second, since a long one would ignore Ctrl-C.
    """
    while not stopped():
        try:
            return zenoh.open(config)
        except zenoh.ZError as error:
            if "Unable to connect" not in str(error):
                raise InputError(Fault("zenoh", "", _as_line(error))) from None
            on_retry()
    return None


def bypasses(session: zenoh.Session) -> list[str]:
    """Return the rules that a side's network breaks: it must see exactly one router and no peers."""
    routers, peers = session.info.routers_zid(), session.info.peers_zid()
    faults = []
    if len(routers) != 1:
        faults.append(f"sees {len(routers)} Zenoh routers, must see exactly one, netem's")
    if peers:
        faults.append(f"sees {len(peers)} Zenoh peers, must see none: they would bypass netem")
    return faults


def publisher_of(session: zenoh.Session, key: str, express: bool = True) -> zenoh.Publisher:
    """Return a publisher of JSON at the highest priority: reliable, but dropped by a full queue, without blocking.

    ``express``: each message is sent at once, as a batch of its own, as those of the control plane are.
    """
    return session.declare_publisher(
        key,
        encoding=zenoh.Encoding.APPLICATION_JSON,
        congestion_control=zenoh.CongestionControl.DROP,
        reliability=zenoh.Reliability.RELIABLE,
        priority=zenoh.Priority.REAL_TIME,
        express=express,
        allowed_destination=zenoh.Locality.REMOTE,
    )


def merge_acceptor() -> None:
    """Let Zenoh's receiving threads watch the sockets of its clients; call it before the first session opens.

    By default another thread watches them and wakes a receiving one for each message, which was a tenth of what a
    message costs netem at 1 kHz. What the user has set stays. Fewer threads than that lose messages: one that both
    receives and sends cannot send while it waits for a callback.
    """
    os.environ.setdefault("ZENOH_RUNTIME", "(acc: (handover: rx))")


def _as_line(error: Exception) -> str:
    return " ".join(str(error).split()).split(" at /")[0]
