"""The names that estimators go by: the testbed's own, and ``module:factory`` for anybody else's.

Only the text is looked at here. What a name of the second kind stands for is found by `common.runtime.own_code`, in
the processes that estimate.
"""

import difflib
import re
from typing import Annotated, Final, Literal, TypeGuard, get_args

from pydantic import AfterValidator, WithJsonSchema

EstimatorName = Literal[
    "hold",
    "hold_last_arrived",
    "static_gain",
    "velocity",
    "damped_velocity",
    "moesp_kf",
    "n4sid_kf",
    "arx_kf",
    "innovations_kf",
    "direct_ls",
    "paper",
    "paper_as_printed",
]
NAMES: Final[tuple[EstimatorName, ...]] = get_args(EstimatorName)

_WORD: Final = r"[A-Za-z_][A-Za-z0-9_]*"
_PATTERN: Final = rf"^[A-Za-z][A-Za-z0-9_]*(\.{_WORD})*:{_WORD}(\.{_WORD})*$"
_LONGEST: Final = 120
_OWN_RULE: Final = (
    "must read module:factory, both as Python names them, like my_filter:AlphaBeta (ASCII letters, digits, '_' and "
    f"'.', the first a letter, at most {_LONGEST} characters)"
)


def is_own(name: str) -> bool:
    """Tell whether a name is ``module:factory``, which stands for an estimator of the user's own."""
    return ":" in name


def is_ours(name: str) -> TypeGuard[EstimatorName]:
    """Tell whether a name is one of the testbed's."""
    return name in NAMES


def plain_name(name: str) -> str:
    """Return a name as topics and columns have it: letters, digits and ``_``; the testbed's own are that already.

    ``my_filter:AlphaBeta`` becomes ``my_filter__AlphaBeta``, which no name of the testbed's can be.
    """
    return name.replace(":", "__").replace(".", "_")


def fault_of(name: str) -> str | None:
    """Return what is wrong with a name as it is written, None where nothing is."""
    if is_ours(name):
        return None
    if is_own(name):
        return None if re.fullmatch(_PATTERN, name) and len(name) <= _LONGEST else _OWN_RULE
    near = difflib.get_close_matches(name, NAMES, n=2, cutoff=0.6)
    if near:
        return f"no such estimator, did you mean {' or '.join(map(repr, near))}?"
    return f"no such estimator; there are {', '.join(NAMES)}, and module:factory for one of your own"


def _known(name: str) -> str:
    fault = fault_of(name)
    if fault is not None:
        raise ValueError(fault)
    return name


AnyEstimatorName = Annotated[
    str,
    AfterValidator(_known),
    WithJsonSchema(
        {
            "anyOf": [
                {"enum": list(NAMES), "type": "string"},
                {
                    "pattern": _PATTERN,
                    "maxLength": _LONGEST,
                    "type": "string",
                    "description": "module:factory, one of your own",
                },
            ]
        }
    ),
]


def each_once(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names; raises `ValueError` where one comes twice, or two would share their topics."""
    if len(set(names)) != len(names):
        raise ValueError("each estimator at most once")
    plain = [plain_name(name) for name in names]
    alike = [name for name, its in zip(names, plain, strict=True) if plain.count(its) > 1]
    if alike:
        raise ValueError(f"{' and '.join(alike)} must differ by more than '.', ':' and '_', as their topics do not")
    return names
