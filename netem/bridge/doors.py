"""The way of a client of ours to each network: a door of netem's own router, or the way that netem itself takes.

Where netem listens, the door is a Unix socket in a folder that only its user can enter: whatever an endpoint for
applications asks of them (certificates, say), the client comes in.
"""

import tempfile
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import replace
from typing import Final

import zenoh

from common.channels import Network
from common.runtime.zenoh_session import ZenohOptions, configure
from netem.bridge.sides import Place

_LONGEST: Final = 100  # bytes of a Unix socket's path, with the lock file beside it; Linux takes 107

Doors = Mapping[Network, str]


def open_doors(stack: ExitStack, places: Mapping[Network, Place], options: ZenohOptions) -> Doors:
    """Return an endpoint more for each network that netem listens for, where it can have one; gone with ``stack``."""
    protocols = configure("router", options).get_json("transport/link/protocols")
    if protocols != "null" and "unixsock-stream" not in protocols:
        return {}
    folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="tis-netem-", ignore_cleanup_errors=True))
    paths = {network: f"{folder}/{network}" for network, place in places.items() if place.listen}
    return {network: f"unixsock-stream/{path}" for network, path in paths.items() if len(path.encode()) <= _LONGEST}


def lister_configs(
    places: Mapping[Network, Place],
    options: ZenohOptions,
    doors: Doors,
    sessions: Mapping[Network, zenoh.Session],
) -> dict[Network, zenoh.Config]:
    """Return the configuration of a client that lists what a network has, for each network with a router.

    Without a door, it goes where applications go.
    """
    configs: dict[Network, zenoh.Config] = {}
    for network, place in places.items():
        way = (doors[network],) if network in doors else place.listen or place.connect
        if place.listen or sessions[network].info.routers_zid():
            configs[network] = lister_config(replace(options, connect=way))
    return configs


def lister_config(options: ZenohOptions) -> zenoh.Config:
    """Return the configuration of a client that reads its own admin space."""
    own = (*options.cfg, "listen/endpoints:[]", "adminspace/enabled:true")
    return configure("client", replace(options, listen=(), cfg=own))
