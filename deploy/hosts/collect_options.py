"""The three uses of `tis collect`, told apart by its options."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final, Literal, NamedTuple

from tis.common.errors import Fault, InputError
from tis.common.zenoh_syntax import endpoint_faults
from tis.deploy.hosts.protocol import RUN_NAME

_WHERE: Final = "tis collect"
_PROTOCOLS: Final = ("tcp", "tls", "quic", "ws", "udp", "unixsock-stream", "vsock", "serial")

Kind = Literal["hosts", "zenoh", "offer"]


class Asked(NamedTuple):
    """The options as typed."""

    sources: Sequence[str]
    offer: Path | None
    connect: Sequence[str]
    listen: Sequence[str]
    run: str | None


def check_options(asked: Asked) -> Kind:
    """Return which use is meant; raises `InputError` with all options that contradict each other."""
    sources = [source for source in asked.sources if not _is_endpoint(source)]
    found = endpoint_faults(_WHERE, {"--connect": asked.connect, "--listen": asked.listen, "ENDPOINT": _of(asked)})
    kind: Kind = "offer" if asked.offer is not None else "hosts" if sources else "zenoh"
    if kind == "offer":
        found += _rules({
            "--offer": ("must not stand beside sources", asked.sources),
            "--connect, --listen": ("one of both must be given with --offer", not (asked.connect or asked.listen)),
        })  # fmt: skip
    if kind == "hosts":
        others = len(asked.sources) > 1 or asked.listen
        found += _rules({"HOSTS_FILE": ("must be given alone, once", others)})
    if kind == "zenoh":
        found += _rules({"HOSTS_FILE": ("a hosts file, endpoints or --listen must be given", not _any(asked))})
    if kind != "offer" and asked.connect:
        found.append(Fault(_WHERE, "--connect", "is for --offer; a collector's endpoints stand without option"))
    if asked.run is not None and not RUN_NAME.fullmatch(asked.run):
        found.append(Fault(_WHERE, "--run", "must be the name of a run, such as 20260102_030405_default", asked.run))
    elif asked.run is not None and kind != "hosts":
        found.append(Fault(_WHERE, "--run", "is for a hosts file", asked.run))
    if asked.listen and (asked.connect or _of(asked)):
        found.append(Fault(_WHERE, "--listen", "must not stand beside endpoints to connect to"))
    if found:
        raise InputError(found)
    return kind


def _rules(broken: dict[str, tuple[str, object]]) -> list[Fault]:
    return [Fault(_WHERE, option, rule) for option, (rule, is_broken) in broken.items() if is_broken]


def _any(asked: Asked) -> bool:
    return bool(asked.sources or asked.listen)


def _of(asked: Asked) -> list[str]:
    return [source for source in asked.sources if _is_endpoint(source)]


def _is_endpoint(source: str) -> bool:
    return source.partition("/")[0] in _PROTOCOLS and "/" in source
