"""Private endpoints: Unix sockets on which netem's own routers accept netem's own clients.

They lie in a folder that only its user can enter, so that a client connects even where the endpoints for applications
require certificates.
"""

import tempfile
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import replace
from typing import Final

import zenoh

from tis.common.channels import Network
from tis.common.runtime.zenoh_session import ZenohOptions, configure
from tis.netem.bridge.sides import Place

_MAX_PATH_BYTES: Final = 100  # of a Unix socket and the lock file beside it; Linux accepts 107

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
