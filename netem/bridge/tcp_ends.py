"""Ends of this host's TCP connections, as the kernel tells them to anybody: sock_diag(7) over netlink."""

import socket
import struct
import threading
from collections.abc import Callable
from typing import Final

_SOCK_DIAG: Final = 4
_TCP_ENDS: Final = 0b101  # its groups for TCP over IPv4 and IPv6
_IDS: Final = struct.Struct("!HH16s16s")
_FAMILY_AT: Final = 16  # behind the head of netlink
_IDS_AT: Final = 20  # behind that of inet_diag, too


def tcp_ends_socket(time_out_s: float) -> socket.socket:
    """Return a socket that receives a notice of each connection that ends; raises `OSError` where there is none."""
    kernel = socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, _SOCK_DIAG)
    kernel.bind((0, _TCP_ENDS))
    kernel.settimeout(time_out_s)
    return kernel


def hear_tcp_ends(kernel: socket.socket, take: Callable[[int, str], None], over: threading.Event) -> None:
    """Call ``take`` with this host's port and the other end's address of each that ends, until ``over``."""
    with kernel:
        while not over.is_set():
            try:
                message = kernel.recv(1 << 16)
            except (TimeoutError, OSError):  # nothing, or more than it holds
                continue
            if len(message) < _IDS_AT + _IDS.size:
                continue
            port, other, _, address = _IDS.unpack_from(message, _IDS_AT)
            family = message[_FAMILY_AT]
            host = socket.inet_ntop(family, address if family == socket.AF_INET6 else address[:4])
            host = host.removeprefix("::ffff:")
            take(port, f"[{host}]:{other}" if ":" in host else f"{host}:{other}")
