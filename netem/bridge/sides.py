"""The two sessions of the bridge: each listens as a router, or connects to an existing network.

netem's own routers accept its own clients on private endpoints: Unix sockets in a folder that only its user can
enter, so that a client connects even where the endpoints for applications require certificates.
"""

import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Final, Literal, get_args

import zenoh

from tis.common.channels import Network
from tis.common.errors import Fault, InputError, PeerError
from tis.common.runtime.connections import closing
from tis.common.runtime.zenoh_session import ZenohOptions, configure, open_client

ClientMode = Literal["client", "peer"]

_PAUSE_S: Final = 0.2
_ENDS: Final = "--west, --east, --connect-west and --connect-east"
_SCOUTING: Final = ("scouting/multicast/address", "scouting/multicast/interface")
_MAX_PATH_BYTES: Final = 100  # of a Unix socket and the lock file beside it; Linux accepts 107


@dataclass(frozen=True)
class Place:
    """The endpoints of one side of the bridge: it listens, or connects, or both (then it is a router)."""

    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()

    def described(self, mode: ClientMode) -> str:
        """Return a description; a peer also listens, on a port that Zenoh chooses."""
        words = [f"listening on {', '.join(self.listen)}"] if self.listen else []
        words += [f"connected to {', '.join(self.connect)}"] if self.connect else []
        words += ["as a peer, which listens on a free port of every interface"] * (mode == "peer" and not self.listen)
        return ", ".join(words)


Places = Mapping[Network, Place]


def check_places(places: Places) -> None:
    """Raise `InputError` if a side has no endpoint, or if the two sides share one."""
    faults = [
        Fault("netem", f"--{network}", f"is required, or --connect-{network}: where that network is")
        for network, place in places.items()
        if not (place.listen or place.connect)
    ]
    seen: dict[str, Network] = {}
    for network, place in places.items():
        for endpoint in (*place.listen, *place.connect):
            other = seen.setdefault(_plain(endpoint), network)
            if other != network:
                faults.append(Fault("netem", f"--{network}", "must not be an endpoint of the other side", endpoint))
    if faults:
        raise InputError(faults)


def check_options(options: ZenohOptions) -> None:
    """Raise `InputError` if Zenoh's own options name endpoints, which both sides would share."""
    config, untouched = configure("client", options), zenoh.Config()
    faults = [
        Fault("netem", "--config, --cfg", f"must not give {key}: {_ENDS} say where netem is", config.get_json(key))
        for key in ("listen/endpoints", "connect/endpoints")
        if config.get_json(key) not in (untouched.get_json(key), "[]")
    ]
    if faults:
        raise InputError(faults)


def open_sides(
    stack: ExitStack,
    places: Places,
    options: ZenohOptions,
    mode: ClientMode,
    stopped: Callable[[], bool],
    on_waiting: Callable[[str], None],
    private: Mapping[Network, str],
) -> dict[Network, zenoh.Session] | None:
    """Open both sessions, and retry until those that connect are answered; return None if ``stopped``.

    ``private`` are endpoints to listen on in addition to those of the places. Raises `InputError`, and
    `PeerError` if netem cannot listen on an endpoint.
    """
    sessions: dict[Network, zenoh.Session] = {}
    for network in get_args(Network):
        place = places[network]
        own = replace(options, listen=place.listen, connect=place.connect)
        config = configure(mode, own)
        if place.listen:
            config = configure("router", replace(own, listen=(*place.listen, *filter(None, (private.get(network),)))))
        where = ", ".join(place.connect)

        def retry(network: Network = network, where: str = where) -> None:
            on_waiting(f"the {network} network at {where}")
            time.sleep(_PAUSE_S)

        try:
            session = open_client(config, stopped, retry)
        except InputError as error:
            if place.listen and "listen" in str(error).lower():
                where = ", ".join(place.listen)
                raise PeerError(Fault("netem", where, "cannot listen here: in use or not of this host")) from None
            raise
        if session is None:
            return None
        sessions[network] = stack.enter_context(closing(session, config))
    return sessions


def lease_s(options: ZenohOptions) -> float:
    """Return the configured lease: how long a silent connection counts as alive."""
    return float(configure("client", options).get_json("transport/link/tx/lease")) * 1e-3


def scout_config(options: ZenohOptions) -> zenoh.Config:
    """Return a configuration that scouts as the user's does, even if netem's own sides do not scout."""
    config, theirs = zenoh.Config(), configure("client", options)
    for key in _SCOUTING:
        value = theirs.get_json(key)
        if value != "null":
            config.insert_json5(key, value)
    return config


def _plain(endpoint: str) -> str:
    """Return an endpoint without parameters and with the numeric loopback address."""
    bare = endpoint.partition("?")[0].partition("#")[0]
    return bare.replace("localhost", "127.0.0.1").replace("[::1]", "127.0.0.1").lower()


PrivateEndpoints = Mapping[Network, str]


def open_private_endpoints(
    stack: ExitStack, places: Mapping[Network, Place], options: ZenohOptions
) -> PrivateEndpoints:
    """Return a private endpoint for each network in which netem listens, if possible; ``stack`` removes them."""
    protocols = configure("client", options).get_json("transport/link/protocols")
    if protocols != "null" and "unixsock-stream" not in protocols:
        return {}
    folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="tis-netem-", ignore_cleanup_errors=True))
    paths = {network: f"{folder}/{network}" for network, place in places.items() if place.listen}
    return {
        network: f"unixsock-stream/{path}" for network, path in paths.items() if len(path.encode()) <= _MAX_PATH_BYTES
    }


def lister_configs(
    places: Mapping[Network, Place],
    options: ZenohOptions,
    private: PrivateEndpoints,
    sessions: Mapping[Network, zenoh.Session],
) -> dict[Network, zenoh.Config]:
    """Return the configuration of a client that lists the queryables of a network, for each network with a router.

    Without a private endpoint the client connects as applications do.
    """
    configs: dict[Network, zenoh.Config] = {}
    for network, place in places.items():
        connect = (private[network],) if network in private else place.listen or place.connect
        if place.listen or sessions[network].info.routers_zid():
            configs[network] = lister_config(replace(options, connect=connect))
    return configs


def lister_config(options: ZenohOptions) -> zenoh.Config:
    """Return the configuration of a client that reads its own admin space."""
    own = (*options.cfg, "listen/endpoints:[]", "adminspace/enabled:true")
    return configure("client", replace(options, listen=(), cfg=own))
