"""Ownership of a network's queryables: netem's own mirrors, or queryables of applications.

A router declares the keys of queryables to a client, but not their owners. The matching status of the queriers of
netem's own session adds whether others answer a key, and whether one of them is complete.
"""

from collections.abc import Container, Mapping
from typing import Final, Protocol

import zenoh

_CHUNK: Final = "4f1c-netem-sample"
_DEPTH: Final = 5


class Listed(Protocol):
    """A queryable that a network lists."""

    @property
    def expr(self) -> zenoh.KeyExpr:
        """Its key expression."""

    @property
    def is_answered(self) -> bool:
        """Whether others than netem answer its `sample`."""

    @property
    def is_complete(self) -> bool:
        """Whether others than netem have a complete queryable that includes it."""


def sample(expr: zenoh.KeyExpr) -> zenoh.KeyExpr:
    """Return a key that only an expression, and those that include it, are likely to match."""
    deep = "/".join([_CHUNK] * _DEPTH)
    chunks = (deep if c == "**" else c.replace("$*", _CHUNK).replace("*", _CHUNK) for c in str(expr).split("/"))
    return zenoh.KeyExpr("/".join(chunks))


def owned_by_others(listed: Mapping[str, Listed], own: Container[str]) -> set[str]:
    """Return the keys of queryables of others; ``own`` are the keys of netem's queryables in that network.

    If netem has the same expression, others have it too when they answer its sample and no wider listed queryable of
    theirs explains the answer. One that is explained counts only if it is complete and the wider one is not.
    """
    answered = [key for key, one in listed.items() if one.is_answered]
    found = {key for key in answered if key not in own}
    doubtful = [key for key in answered if key in own]
    width = {key: sum(listed[key].expr.includes(listed[other].expr) for other in doubtful) for key in doubtful}
    for key in sorted(doubtful, key=lambda key: (-width[key], key)):
        one, probe = listed[key], sample(listed[key].expr)
        wider = [listed[other] for other in found if listed[other].expr.includes(probe)]
        if not wider or (one.is_complete and not any(other.is_complete for other in wider)):
            found.add(key)
    return found
