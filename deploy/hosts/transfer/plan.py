"""Decision what to fetch of a log, from what its source offers and what is here."""

from typing import NamedTuple

from deploy.hosts.transfer.offered_logs import OfferedLog


class Held(NamedTuple):
    """What is here of a log: the SHA-256 of the whole file, and size and SHA-256 of a part of it."""

    sha256: str | None = None
    n_part_bytes: int = 0
    part_sha256: str | None = None


class Fetch(NamedTuple):
    """A range of a log to fetch; ``begin`` is 0 for a log that is fetched anew."""

    log: OfferedLog
    begin: int


def plan_fetch(offered: OfferedLog, held: Held) -> Fetch | None:
    """Return what to fetch, None when the log is here already.

    A part is continued only if the source's log begins with the same bytes. A log that changed there starts anew, and
    one that only grew goes on.
    """
    if held.sha256 == offered.sha256:
        return None
    continues = (
        0 < held.n_part_bytes <= offered.n_bytes
        and held.part_sha256 is not None
        and held.part_sha256 == offered.part_sha256
    )
    return Fetch(offered, held.n_part_bytes if continues else 0)
