"""Software of a cluster's hosts, compared with the client's: only equal software gives equal results."""

import importlib.metadata
from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

from deploy.compare.cells.digests import software_digest

_PACKAGE: Final = "tis-testbed"


class Software(NamedTuple):
    """Version of tis, and the digest of all code and libraries behind a result."""

    version: str
    digest: str

    def __str__(self) -> str:
        return f"tis {self.version} ({self.digest})"


def here() -> Software:
    """Return the client's software."""
    return Software(importlib.metadata.version(_PACKAGE), software_digest())


def fault_of_scheduler(client: Any) -> str | None:
    """Return the difference between the scheduler's version of tis and the client's; None if there is none."""
    found = client.get_versions(packages=[_PACKAGE])["scheduler"]["packages"].get(_PACKAGE)
    return None if found == here().version else f"the scheduler has {_named(found)}, this is {here()}"


def software_of(client: Any, addresses: Sequence[str]) -> dict[str, str]:
    """Return the software of workers in words, by address; one that gives no answer is left out.

    It equals ``str(here())`` where version, code and libraries are the client's.
    """
    versions = client.get_versions(packages=[_PACKAGE])
    own, of_workers = versions["client"]["packages"], versions["workers"]
    found = {}
    for address in addresses:
        packages = (of_workers.get(address) or {}).get("packages")
        if packages is None:
            continue
        # First what decides whether the worker can run the question for its code.
        if packages["python"].split(".")[:2] != own["python"].split(".")[:2]:
            found[address] = f"Python {packages['python']} instead of {own['python']}"
        elif packages.get(_PACKAGE) != own[_PACKAGE]:
            found[address] = _named(packages.get(_PACKAGE))
        else:
            answers = client.run(_question(), workers=[address], on_error="ignore")
            if address in answers:
                found[address] = str(Software(packages[_PACKAGE], answers[address]))
    return found


def _named(version: str | None) -> str:
    return "no tis" if version is None else f"tis {version}"


def _question() -> Callable[[], str]:
    """Return a question for the digest of a worker's software; its code travels with it, as it is not a module's."""

    def ask() -> str:
        try:
            from deploy.compare.cells.digests import software_digest

            return software_digest()
        except Exception as error:
            return f"{type(error).__name__}: {error}"

    return ask
