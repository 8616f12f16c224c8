"""The driver's seat: one page at a time moves the hand, at a bounded rate; the hand stays where it was left."""

from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Final

from tis.deploy.view.drive.hand_move import HandMove

Place = tuple[float, float, float]

MAX_RATE_HZ: Final = 100
"""Moves a second that are taken from a page; the page sends 40."""

MAX_DROPPED: Final = 1000
"""Moves beyond that rate after which a page is shown out."""

IDLE_S: Final = 3.0
"""Time without a move after which another page may drive."""

_BURST: Final = 50.0


@dataclass
class Rate:
    """Budget of one page: moves that it may still make (a token bucket), and how many were beyond it."""

    left: float = _BURST
    at_s: float = 0.0
    n_dropped: int = 0

    def takes(self, now_s: float) -> bool:
        """Tell whether one more move is within the rate; count it otherwise."""
        self.left = min(_BURST, self.left + MAX_RATE_HZ * max(now_s - self.at_s, 0.0))
        self.at_s = now_s
        if self.left < 1.0:
            self.n_dropped += 1
            return False
        self.left -= 1.0
        return True


@dataclass
class Seat:
    """Who drives, and the hand. A page that takes the seat moves the hand on from where it is."""

    driver: Hashable | None = None
    hand_mm: Place = (0.0, 0.0, 0.0)
    gripper_rad: float = 0.0
    last_s: float = 0.0
    _base_mm: Place = field(default=(0.0, 0.0, 0.0))

    def drive(self, page: Hashable, move: HandMove, now_s: float) -> bool:
        """Move the hand for a page; False when another page drives. A page that drives no more leaves the seat.

        Oracle: positions added by hand, tests/deploy/view/drive/test_seat.
        """
        if self.driver != page:
            if self.driver is not None and now_s - self.last_s < IDLE_S:
                return False
            self.driver, self._base_mm = page, self.hand_mm
        x, y, z = self._base_mm
        dx, dy, dz = move.moved_mm
        self.hand_mm = (x + dx, y + dy, z + dz)
        self.gripper_rad, self.last_s = move.gripper_rad, now_s
        if move.release:
            self.leave(page)
        return True

    def leave(self, page: Hashable) -> None:
        """Free the seat, if it is this page's; the hand holds."""
        if self.driver == page:
            self.driver = None
