"""Known ways in which a message's content raises: tolerated, counted apart, and to be emptied.

An entry is the place where the exception leaves the project's code (``file:function``), its type, and why.
"""

from typing import Final, NamedTuple


class Issue(NamedTuple):
    """A known issue."""

    place: str
    error: str
    why: str


KNOWN: Final[tuple[Issue, ...]] = (
    Issue(
        "patient_side/answers.py:answer",
        "ValidationError",
        "constant_rate and tangent_ls extrapolate the gripper's angle, from +-1e9 rad beyond what a message can hold",
    ),
    Issue(
        "patient_side/driven.py:set_point",
        "ValidationError",
        "with limits of metres by the thousand million a set point may overshoot what a message can hold",
    ),
)


def is_known(place: str, error: BaseException) -> bool:
    """Tell whether an exception at a place is a known issue."""
    return any(one.place == place and one.error == type(error).__name__ for one in KNOWN)
