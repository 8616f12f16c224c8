"""The frames of a run as the camera sent them, and what the screen made of each."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from tis.common.metrics.sight import Freezes, freezes, hand_to_eye_ns
from tis.common.scenario import Scenario
from tis.common.sight_records import CAMERA, SCREEN
from tis.common.units import NS_PER_S, sample_index, sample_instant_ns
from tis.deploy.logs.read.columns import Ints
from tis.deploy.logs.read.frame import Frame
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.report.subjects.ticks import active_duration_s

STATES: Final = ("complete", "concealed", "torn", "undecodable", "lost")


@dataclass(frozen=True)
class Pictures:
    """The frames of a run: (N,) as the camera sent them, and what the screen made of each.

    Of an external camera (``is_external``) the stamps, if it draws any, tell the command alone: it counts its frames
    by itself.
    """

    camera: Frame
    screen: Frame
    rate_hz: int
    until_ns: int
    is_external: bool = False

    @classmethod
    def of(cls, logs: RunLogs, scenario: Scenario) -> Self | None:
        """Return the frames; None for a run without sight, or without the camera's records."""
        if scenario.sight is None:
            return None
        camera = logs.of("patient", CAMERA).first_of_each("frame")
        if not len(camera):
            return None
        screen = logs.of("surgeon", SCREEN).first_of_each("frame")
        screen = screen.at(np.isin(screen.frame, camera.frame))
        until_ns = round(active_duration_s(logs, "surgeon", scenario) * NS_PER_S)
        return cls(camera, screen, scenario.rate_hz, until_ns, scenario.sight.is_external)

    @cached_property
    def seen(self) -> Frame:
        """Return the screen's records of frames that it showed, in that order."""
        shown = self.screen.at(np.isfinite(self.screen.shown_ns))
        return shown.at(np.argsort(shown.shown_ns, kind="stable"))

    @cached_property
    def shown_ns(self) -> Ints:
        """Return when each of `seen` was shown."""
        return self.seen.shown_ns.astype(np.int64)

    @cached_property
    def screen_ns(self) -> Ints:
        """Return how long after its last message each of `seen` that came whole was shown."""
        whole = self.seen.state == "complete"
        return np.asarray(self.shown_ns[whole] - self.seen.last_ns[whole].astype(np.int64))

    @cached_property
    def stamped(self) -> NDArray[np.bool_]:
        """Mark those of `seen` whose stamps agree with each other, and of our camera name a frame that was sent."""
        one = self.seen
        agree = (one.top_frame == one.bottom_frame) & (one.top_command == one.bottom_command)
        return np.asarray(agree & (self.is_external | np.isin(one.top_frame, self.camera.frame)))

    @cached_property
    def has_stamps(self) -> bool:
        """Tell whether any picture had a stamp; that of our camera always has."""
        read = np.isfinite(self.screen.top_frame) | np.isfinite(self.screen.bottom_frame)
        return not self.is_external or bool(read.any())

    @cached_property
    def dated(self) -> NDArray[np.bool_]:
        """Mark those of `seen` of which it is known which frame they show: by stamps, or since all of it came."""
        return np.asarray(self.seen.state == "complete") if self.is_external else self.stamped

    @cached_property
    def captured_ns(self) -> Ints:
        """Return when what is in each of the dated pictures was captured."""
        frame = self.seen.frame if self.is_external else self.seen.top_frame
        return np.asarray(
            self.camera.captured_ns[np.searchsorted(self.camera.frame, frame[self.dated].astype(np.int64))]
        )

    @cached_property
    def n_unreadable(self) -> int:
        """Return the number of frames that refer to no other, arrived whole, and were no picture."""
        camera = self.camera
        is_whole = (self.arrived == camera.n_fragments) & camera.is_key.astype(bool)
        return int(np.count_nonzero((self.states == "undecodable") & is_whole))

    @cached_property
    def states(self) -> NDArray[np.str_]:
        """Return the state (N,) of each frame sent; one that the screen has no record of is lost."""
        found = np.full(len(self.camera), "lost", dtype="<U11")
        found[np.searchsorted(self.camera.frame, self.screen.frame)] = self.screen.state
        return found

    @cached_property
    def arrived(self) -> Ints:
        """Return how many fragments (N,) of each frame sent arrived."""
        found = np.zeros(len(self.camera), dtype=np.int64)
        found[np.searchsorted(self.camera.frame, self.screen.frame)] = self.screen.fragments
        return found

    @cached_property
    def freezes(self) -> Freezes:
        """Return the freezes of the picture, until the surgeon's last tick."""
        return freezes(self.shown_ns, self.until_ns)

    @cached_property
    def hand_to_eye_ns(self) -> Ints:
        """Return the time from each command's sample to the first picture that shows its effect.

        Which commands an external camera drew is told by stamps alone: those that nobody could read are left out.
        """
        command = self.seen.top_command[self.stamped].astype(np.int64)
        drawn = command if self.is_external else self.camera.command.astype(np.int64)
        n = sample_index(self.until_ns, self.rate_hz)
        instants = {i: sample_instant_ns(i, self.rate_hz) for i in np.unique(drawn).tolist() if 0 <= i <= n}
        return hand_to_eye_ns(drawn, command, self.shown_ns[self.stamped], instants, self.until_ns)
