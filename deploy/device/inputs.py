"""Mouse and gamepad, read through pygame-ce (SDL), which is loaded only when one of them is used."""

import os
from collections.abc import Callable
from typing import Any, Final, Literal

from tis.common.errors import Fault, InputError
from tis.common.extras import GET_DEVICE
from tis.surgeon_side import devices
from tis.surgeon_side.devices import Handle

Kind = Literal["mouse", "gamepad"]
COMMAND: Final = "tis device"

_SIZE_PX: Final = (640, 480)
_TEXT: Final = {
    "mouse": "move: x, y   wheel: depth   left button: gripper   right button: clutch   Esc: end",
    "gamepad": "left stick: x, y   right stick: depth   right trigger: gripper   A: clutch   Esc: end",
}
_BUTTONS: Final[dict[int, devices.Button]] = {1: "left", 3: "right"}
_LEFT_X, _LEFT_Y, _RIGHT_Y, _TRIGGER, _CLUTCH = 0, 1, 4, 5, 0


class Inputs:
    """A window that has the mouse or a gamepad; `read` moves the handle by what happened since the last call."""

    def __init__(self, kind: Kind, pygame: Any) -> None:
        self._pygame, self._kind = pygame, kind
        self._pad = _first_gamepad(pygame) if kind == "gamepad" else None
        self.handle = Handle()
        self.is_over = False

    def read(self, dt_ns: int) -> Handle:
        """Return the handle now, ``dt_ns`` after the last call; `is_over` tells that the window was closed."""
        for event in self._pygame.event.get():
            self._take(event)
        if self._pad is not None:
            self.handle = devices.moved_by_sticks(self.handle, _sticks(self._pad), dt_ns)
        return self.handle

    def _take(self, event: Any) -> None:
        pygame = self._pygame
        if event.type == pygame.QUIT or (event.type == pygame.KEYDOWN and event.key == pygame.K_ESCAPE):
            self.is_over = True
        if self._kind != "mouse":
            return
        if event.type == pygame.MOUSEMOTION:
            self.handle = devices.moved_by_mouse(self.handle, devices.Moved(*event.rel))
        elif event.type == pygame.MOUSEWHEEL:
            self.handle = devices.moved_by_mouse(self.handle, devices.Turned(event.y))
        elif event.type in (pygame.MOUSEBUTTONDOWN, pygame.MOUSEBUTTONUP) and event.button in _BUTTONS:
            is_down = event.type == pygame.MOUSEBUTTONDOWN
            self.handle = devices.moved_by_mouse(self.handle, devices.Pressed(_BUTTONS[event.button], is_down))


def open_inputs(kind: Kind, load: Callable[[], Any] | None = None) -> Inputs:
    """Open the window, and find the gamepad; raises `InputError` without the extra, a display or a gamepad."""
    pygame = (load or _pygame)()
    try:
        pygame.display.init()
        window = pygame.display.set_mode(_SIZE_PX)
    except pygame.error as error:
        rule = f"needs a display for its window ({error}); over ssh, run it on the host with the {kind}"
        raise InputError(Fault(COMMAND, kind, rule)) from None
    pygame.display.set_caption(f"tis device {kind}: {_TEXT[kind]}")
    window.fill((30, 34, 40))
    pygame.display.flip()
    return Inputs(kind, pygame)


def close_inputs(inputs: Inputs) -> None:
    """Close the window."""
    inputs._pygame.quit()


def _pygame() -> Any:
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    try:
        import pygame
    except ImportError:
        raise InputError(Fault(COMMAND, "", f"needs the package pygame-ce: {GET_DEVICE}")) from None
    return pygame


def _first_gamepad(pygame: Any) -> Any:
    pygame.joystick.init()
    if not pygame.joystick.get_count():
        raise InputError(Fault(COMMAND, "gamepad", "needs a gamepad; none is connected"))
    return pygame.joystick.Joystick(0)


def _sticks(pad: Any) -> devices.Sticks:
    """Return the state of a gamepad; axes and buttons that it lacks are at rest."""
    axes = [pad.get_axis(i) for i in range(pad.get_numaxes())] + [0.0] * (_TRIGGER + 1)
    # a trigger rests at -1 and is pulled to 1; some drivers tell 0 until it is first touched
    trigger = (axes[_TRIGGER] + 1.0) / 2.0 if pad.get_numaxes() > _TRIGGER and axes[_TRIGGER] else 0.0
    clutch = bool(pad.get_numbuttons() > _CLUTCH and pad.get_button(_CLUTCH))
    return devices.Sticks(axes[_LEFT_X], axes[_LEFT_Y], axes[_RIGHT_Y], trigger, clutch)
