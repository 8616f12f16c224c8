"""Why netem dropped what it dropped, in one clause."""

from collections.abc import Mapping
from typing import Any


def drop_reasons(links: Mapping[str, Any]) -> str:
    """Return the reasons that occurred, as `` (forward: 3 loss, 705 queue_full)``; nothing without any.

    Oracle: literals, tests/deploy/report/tables/test_drop_reasons.
    """
    said = []
    for direction, link in links.items():
        reasons = link.get("dropped_by") or {}
        if reasons:
            said.append(f"{direction}: " + ", ".join(f"{n} {reason}" for reason, n in reasons.items()))
    return f" ({'; '.join(said)})" if said else ""
