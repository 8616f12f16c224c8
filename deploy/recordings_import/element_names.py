"""Names of a vector's elements in LeRobot sets, like left_x or psm1_qw, which tell devices and parts of a pose.

Those of LeRobot's own end effectors are ee.x, ee.y, ee.z, a rotation vector ee.wx, ee.wy, ee.wz in rad, and
ee.gripper_pos.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from tis.common.channels import FOLLOWER, MASTER, Hand

_SIDES: Final[Mapping[str, Hand]] = {
    "left": "left", "l": "left", "mtml": "left", "psm2": "left",
    "right": "right", "r": "right", "mtmr": "right", "psm1": "right",
}  # fmt: skip
_GRIPPERS: Final = ("gripper", "jaw", "grip")
_TURNED: Final = ("quat", "quaternion", "orientation", "rot", "rotation", "ori", "q")
_EULER: Final = ("roll", "pitch", "yaw")
_ROTATION_VECTOR: Final = ("wx", "wy", "wz")
_NOT_PLACES: Final = frozenset(("delta", "vel", "velocity", "twist", "acc", "force", "torque", "wrench", "effort"))
_OF_ARMS: Final = frozenset(("psm1", "psm2", "sp", "setpoint"))
OF_JOINTS: Final = re.compile(r"(?i)joint|shoulder|elbow|wrist|waist|forearm|motor")
"""Found in the names of joints, whose angles are no positions of a hand."""


@dataclass(frozen=True)
class Elements:
    """Places of a device's numbers in a vector: position, gripper, and one form of orientation at most.

    ``euler`` are roll, pitch and yaw.
    """

    device: str
    position: tuple[int, int, int]
    quaternion: tuple[int, int, int, int] | None
    euler: tuple[int, int, int] | None
    gripper: int | None
    rotation_vector: tuple[int, int, int] | None = None


def names_in(feature: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the names of a feature of meta/info.json: a list, or lists in a list or map; empty without any."""
    names = feature.get("names")
    lists = list(names.values()) if isinstance(names, Mapping) else names
    if isinstance(lists, list) and lists and all(isinstance(each, list) for each in lists):
        names = [name for each in lists for name in each]
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        return ()
    return tuple(names)


_UNITS: Final = {"n": "N", "nm": "N m", "m": "m", "mm": "mm", "rad": "rad", "deg": "deg", "a": "A", "v": "V",
                 "m/s": "m/s", "rad/s": "rad/s", "pa": "Pa", "s": "s"}  # fmt: skip
_SUFFIX: Final = {"N m": "n_m", "m/s": "m_s", "rad/s": "rad_s"}
OF_FORCES: Final = re.compile(r"(?i)force|torque|wrench|effort")
"""Found in the names of vectors of forces, which are kept though their unit is not stated."""


def units_in(feature: Mapping[str, Any], n: int) -> tuple[str, ...] | None:
    """Return the units that a feature states for its ``n`` elements; None without any, or of units not known here.

    ``"units": "N + N m"``, in the feature or its ``info``, are those of the first and second half. Oracle: the forms
    of Open-H-Embodiment's guide, test_element_names.
    """
    about = feature.get("info")
    places = [place for place in (about, feature) if isinstance(place, Mapping)]
    stated = next((place[key] for place in places for key in ("units", "unit") if key in place), None)
    parts = re.split(r"[+,;]", stated) if isinstance(stated, str) else stated
    if not isinstance(parts, list) or not parts or n % len(parts) or not all(isinstance(one, str) for one in parts):
        return None
    known = [_UNITS.get(re.sub(r"[ *.·]", "", one).lower()) for one in parts]
    found = tuple(unit for unit in known if unit is not None for _ in range(n // len(parts)))
    return found if len(found) == n else None


def column_of(vector: str, element: str, unit: str) -> str:
    """Return the column of a vector's element, like force_torque_fx_n; without a unit it has none in its name."""
    words = [vector.rpartition(".")[2], element, _SUFFIX.get(unit, unit.lower())]
    return "_".join(re.sub(r"[^A-Za-z0-9]+", "_", word).strip("_") for word in words if word)


def elements_of(names: Sequence[str], is_action: bool) -> list[Elements]:
    """Return the devices whose positions a vector holds, by the names of its elements.

    The action is the command: the master's pose, or the arm's set point where its names are those of an arm (psm1) or
    of set points (sp); the state is the arm's. A name tells the hand by left, right, l, r,
    or by a device of the da Vinci; without any, it is the left one. Oracle: names of published sets in the tests.
    """
    parts: dict[Hand, dict[str, int]] = {}
    of_arms = set[Hand]()
    for place, name in enumerate(names):
        words = [word for word in re.split(r"[^a-z0-9]+", re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()) if word]
        hand: Hand = next((_SIDES[word] for word in words if word in _SIDES), "left")
        part = _part(words)
        of_arms |= set() if _OF_ARMS.isdisjoint(words) else {hand}
        if part is not None:
            parts.setdefault(hand, {}).setdefault(part, place)
    found = []
    for hand, places in sorted(parts.items()):
        if not {"x", "y", "z"} <= places.keys():
            continue
        quaternion = tuple(places.get(part, -1) for part in ("qx", "qy", "qz", "qw"))
        euler = tuple(places.get(part, -1) for part in _EULER)
        vector = tuple(places.get(part, -1) for part in _ROTATION_VECTOR)
        turns = quaternion if -1 not in quaternion else None
        angles = euler if turns is None and -1 not in euler else None
        turned = vector if turns is angles is None and -1 not in vector else None
        device = MASTER[hand] if is_action and hand not in of_arms else FOLLOWER[hand]
        position = (places["x"], places["y"], places["z"])
        found.append(Elements(device, position, turns, angles, places.get("gripper"), turned))  # type: ignore[arg-type]
    return found


def _part(words: Sequence[str]) -> str | None:
    """Return which number of a pose the words name: x, y, z, qx .. qw, roll, pitch, yaw, wx, wy, wz or gripper."""
    last = words[-1] if words else ""
    if not _NOT_PLACES.isdisjoint(words):
        return None
    if any(word in _GRIPPERS for word in words):
        return "gripper"
    if last in (*_EULER, *_ROTATION_VECTOR) or last in ("qx", "qy", "qz", "qw"):
        return last
    if last in ("x", "y", "z", "w"):
        return f"q{last}" if last == "w" or any(word in _TURNED for word in words[:-1]) else last
    return None
