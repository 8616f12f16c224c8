"""Known ways in which a message's content raises: tolerated, counted apart, and to be emptied.

An entry is the project's innermost function in the traceback (``file:function``), the exception's type and a piece of
its text, and why.
"""

from typing import Final, NamedTuple


class Issue(NamedTuple):
    """A known issue."""

    place: str
    error: str
    text: str
    why: str


KNOWN: Final[tuple[Issue, ...]] = (
    Issue(
        "patient_side/answers.py:answer",
        "ValidationError",
        "gripper_rad",
        "constant_rate and tangent_ls extrapolate the gripper's angle, from +-1e9 rad beyond what a message can hold",
    ),
    Issue(
        "patient_side/hand.py:vector",
        "ValidationError",
        "for Vector3",
        "where the gate admits 1e9 m, an arm that overshoots or has noise is beyond what a message can hold",
    ),
    Issue(
        "patient_side/driven.py:set_point",
        "ValidationError",
        "for Vector3",
        "with limits of metres by the thousand million a set point may overshoot what a message can hold",
    ),
)


def is_known(place: str, error: BaseException) -> bool:
    """Tell whether an exception at a place is a known issue."""
    kind, text = type(error).__name__, str(error)
    return any(one.place == place and one.error == kind and one.text in text for one in KNOWN)
