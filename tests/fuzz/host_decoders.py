"""Decoders of what hosts of one run say to each other outside the run."""

from typing import Any, Final

from tests.fuzz.scratch_folder import scratch_folder
from tis.common.errors import TisError
from tis.common.scenario.reading import checked_fields
from tis.deploy.hosts.protocol import event_in, request_of
from tis.deploy.hosts.zenoh_logs import answer

_FOLDER: Final = scratch_folder()
(_FOLDER / "netem.mcap").write_bytes(b"log")


def _query_for_logs(data: bytes) -> None:
    answer(_FOLDER, "read" if b"begin" in data else "list", data)


HOST_DECODERS: dict[str, tuple[Any, ...]] = {
    "request to a host": (request_of, [b'{"action":"runs","folder":".","side":"netem"}']),
    "event of a host": (lambda data: event_in(data, "netem"), [b'{"event":"failed","reasons":["a"]}']),
    "another side's scenario": (checked_fields, [b'{"duration_s":"20.0"}']),
    "query for logs": (
        _query_for_logs,
        [b'{"name":"netem.mcap","begin":0,"end":9}', b'{"parts":{"netem.mcap":3}}'],
        (ValueError, TisError),
    ),
}
"""Arguments of `tests.fuzz.decoders.Decoder`, by name."""
