"""Free ports of loopback, for the processes of one machine."""

import errno
import random
import socket
from contextlib import ExitStack
from pathlib import Path
from typing import Final

_HANDED_OUT: Final = Path("/proc/sys/net/ipv4/ip_local_port_range")
_RANDOM: Final = random.SystemRandom()  # two processes with one seed must not find the same


def free_ports(count: int, kind: socket.SocketKind = socket.SOCK_STREAM) -> list[int]:
    """Return different ports of loopback that nothing uses, and that no outgoing connection takes meanwhile.

    The kernel gives an outgoing connection any port of a range, also one that it named free a moment ago. These lie
    outside of that range where it leaves room. Oracle: the kernel's setting, test_ports.
    """
    with ExitStack() as stack:
        found = dict[int, socket.socket]()
        while len(found) < count:
            one = stack.enter_context(socket.socket(socket.AF_INET, kind))
            try:
                one.bind(("127.0.0.1", _not_handed_out()))
            except OSError as error:
                if error.errno != errno.EADDRINUSE:
                    raise
            else:
                found[one.getsockname()[1]] = one
        return list(found)


def _not_handed_out() -> int:
    """Return a port at random outside of those which the kernel hands out, or 0 if it hands out nearly all."""
    try:
        first, last = map(int, _HANDED_OUT.read_text().split())
    except (OSError, ValueError):
        first, last = 32_768, 65_535  # Linux begins here, other systems later
    others = [*range(10_000, first), *range(last + 1, 65_536)]
    return _RANDOM.choice(others) if len(others) >= 1000 else 0


def free_endpoints(protocol: str = "tcp") -> tuple[str, str]:
    """Return two loopback endpoints whose ports are free."""
    west, east = (f"{protocol}/127.0.0.1:{port}" for port in free_ports(2))
    return west, east
