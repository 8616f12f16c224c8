"""Names of estimators: the built-in ones, and ``module:factory`` for user-defined ones.

Only the text is checked here; `tis.common.runtime.user_code` imports the factory in the processes that estimate.
"""

import difflib
import re
from typing import TYPE_CHECKING, Annotated, Final, Literal

from pydantic import WithJsonSchema

from tis.common.estimators import ESTIMATORS, LEARNED, NAMES, scenario_name, short_name, successor
from tis.common.scenario.base import obeys

if TYPE_CHECKING:
    LearnedName = str
else:  # the schema lists them
    LearnedName = Literal[LEARNED]
    """Estimators whose models are trained, which takes minutes: only where they are named."""

_WORD: Final = r"[A-Za-z_][A-Za-z0-9_]*"
_PATTERN: Final = rf"^[A-Za-z][A-Za-z0-9_]*(\.{_WORD})*:{_WORD}(\.{_WORD})*$"
_MAX_CHARS: Final = 120
_USER_RULE: Final = (
    "must read module:factory, both Python names, like my_filter:AlphaBeta (ASCII letters, digits, '_' and "
    f"'.', the first a letter, at most {_MAX_CHARS} characters)"
)


def is_user_defined(name: str) -> bool:
    """Tell whether a name has the form ``module:factory``, and is not one of the testbed's."""
    return ":" in name and not is_built_in(name)


def is_built_in(name: str) -> bool:
    """Tell whether a name is that of a built-in estimator, of a method of the studies too."""
    return name in NAMES or short_name(name) != name


def is_learned(name: str) -> bool:
    """Tell whether an estimator's model is trained by a learned method."""
    return short_name(name) in LEARNED


def plain_name(name: str) -> str:
    """Return a name in letters, digits and ``_``, for topics and columns; built-in ones have that of their row.

    ``my_filter:AlphaBeta`` becomes ``my_filter__AlphaBeta``; no built-in name contains ``__``.
    """
    return short_name(name).replace(":", "__").replace(".", "_")


def fault_of(name: str) -> str | None:
    """Return the rule that the text of a name breaks, None for a sound one."""
    if is_built_in(name):
        return None
    if successor(name) is not None:
        return f"is gone: {successor(name)} does what it did"
    if name in ESTIMATORS:
        return f"is a method of `{ESTIMATORS[name].judged_by}`; a scenario names it {scenario_name(name)}"
    if is_user_defined(name):
        return None if re.fullmatch(_PATTERN, name) and len(name) <= _MAX_CHARS else _USER_RULE
    near = difflib.get_close_matches(name, NAMES, n=2, cutoff=0.6)
    if near:
        return f"no such estimator, did you mean {' or '.join(map(repr, near))}?"
    known = ", ".join(NAMES)
    return f"no such estimator; there are {known}, and module:factory for a user-defined one (`tis estimators`)"


AnyEstimatorName = Annotated[
    str,
    obeys(fault_of),
    WithJsonSchema(
        {
            "anyOf": [
                {"enum": list(NAMES), "type": "string"},
                {
                    "pattern": _PATTERN,
                    "maxLength": _MAX_CHARS,
                    "type": "string",
                    "description": "module:factory of a user-defined estimator",
                },
            ]
        }
    ),
]


def each_once(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names; raises `ValueError` where one is repeated, or two would share their topics."""
    if len(set(names)) != len(names):
        raise ValueError("must name each estimator at most once")
    plain = [plain_name(name) for name in names]
    alike = [name for name, its in zip(names, plain, strict=True) if plain.count(its) > 1]
    if alike:
        raise ValueError(f"{' and '.join(alike)} must differ in more than '.', ':' and '_': topics write all as '_'")
    return names
