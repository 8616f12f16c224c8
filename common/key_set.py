"""A set of Zenoh keys, given as keys and as key expressions."""

from collections.abc import Iterable
from typing import Final

from tis.common.key_expression import key_matches


class KeySet:
    """Keys by name, and those that an expression with wildcards holds. Oracle: Zenoh, tests/common/test_key_set."""

    def __init__(self, keys: Iterable[str] = ()) -> None:
        every = frozenset(keys)
        self._plain: Final = frozenset(key for key in every if "*" not in key)
        self._expressions: Final = tuple(sorted(every - self._plain))

    def __contains__(self, key: str) -> bool:
        if key in self._plain:
            return True
        # netem asks for each packet: no generator for nothing
        return bool(self._expressions) and any(key_matches(expression, key) for expression in self._expressions)

    def __bool__(self) -> bool:
        return bool(self._plain or self._expressions)


NO_KEYS: Final = KeySet()
