"""Free endpoints of this host, for processes that are started together."""

import socket


def free_endpoints(protocol: str = "tcp") -> tuple[str, str]:
    """Return two loopback endpoints whose ports are currently free."""
    with socket.socket() as one, socket.socket() as two:
        one.bind(("127.0.0.1", 0))
        two.bind(("127.0.0.1", 0))
        west, east = (f"{protocol}/127.0.0.1:{each.getsockname()[1]}" for each in (one, two))
        return west, east
