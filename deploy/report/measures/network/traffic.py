"""The summary's ``surgeon_traffic``: packets and bytes that the surgeon's side sends."""

from typing import Any

from tis.common.records import COUNTERS, SENT_BYTES, SENT_PACKETS
from tis.deploy.logs.read.load import RunLogs


def surgeon_traffic(logs: RunLogs, duration_s: float) -> dict[str, Any]:
    """Return packets and bytes (payload and attachment) of each key, in total and per second of ``duration_s``.

    Taken from the surgeon's counters, which are written at the end of the run; empty without them. The headers of
    Zenoh, TCP and IP are not included.
    """
    counts = {row["name"]: row["value"] for row in logs.of("surgeon", COUNTERS)}
    keys = [name.removeprefix(f"{SENT_PACKETS}.") for name in counts if name.startswith(f"{SENT_PACKETS}.")]
    traffic = {}
    for key in keys:
        n_packets, n_bytes = counts[f"{SENT_PACKETS}.{key}"], counts[f"{SENT_BYTES}.{key}"]
        traffic[key] = {
            "packets": n_packets,
            "bytes": n_bytes,
            "packets_per_s": n_packets / duration_s,
            "bytes_per_s": n_bytes / duration_s,
        }
    return traffic
