"""Mouse and gamepad through SDL's dummy display; events are posted as a window system would."""

import re
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from tis.common.errors import InputError
from tis.common.extras import GET_DEVICE
from tis.deploy.device.inputs import Inputs, close_inputs, open_inputs

pygame = pytest.importorskip("pygame", reason="pygame-ce is not installed")


@pytest.fixture
def window(monkeypatch: pytest.MonkeyPatch) -> Iterator[Inputs]:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    inputs = open_inputs("mouse")
    inputs.read(0)  # what the window system says of the window itself
    inputs.handle = type(inputs.handle)()
    yield inputs
    close_inputs(inputs)


def post(kind: int, **fields: Any) -> None:
    pygame.event.post(pygame.event.Event(kind, **fields))


def test_the_mouse_in_the_window_moves_the_handle(window: Inputs) -> None:
    post(pygame.MOUSEMOTION, pos=(9, 9), rel=(100, -50), buttons=(0, 0, 0))
    post(pygame.MOUSEWHEEL, x=0, y=2, flipped=False)
    post(pygame.MOUSEBUTTONDOWN, button=3, pos=(0, 0))
    post(pygame.MOUSEBUTTONDOWN, button=7, pos=(0, 0))
    handle = window.read(0)
    assert (handle.x_m, handle.y_m, handle.z_m) == pytest.approx((0.01, 0.005, -0.004))
    assert handle.clutch
    post(pygame.MOUSEBUTTONUP, button=3, pos=(0, 0))
    assert not window.read(0).clutch
    assert not window.is_over


@pytest.mark.parametrize(("kind", "fields"), [("QUIT", {}), ("KEYDOWN", {"key": pygame.K_ESCAPE})])
def test_the_window_is_closed_by_escape_and_by_its_own_button(window: Inputs, kind: str, fields: Any) -> None:
    post(getattr(pygame, kind), **fields)
    window.read(0)
    assert window.is_over


def test_without_a_gamepad_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setattr(pygame.joystick, "get_count", lambda: 0)
    with pytest.raises(InputError, match="tis device: gamepad: needs a gamepad; none is connected"):
        open_inputs("gamepad")
    pygame.quit()


def test_a_gamepad_is_read_as_far_as_it_has_axes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    axes = [1.0, 0.0]
    pad = SimpleNamespace(
        get_numaxes=lambda: len(axes), get_axis=axes.__getitem__, get_numbuttons=lambda: 1, get_button=lambda _: True
    )
    monkeypatch.setattr(pygame.joystick, "get_count", lambda: 1)
    monkeypatch.setattr(pygame.joystick, "Joystick", lambda _: pad)
    inputs = open_inputs("gamepad")
    handle = inputs.read(20_000_000)
    close_inputs(inputs)
    assert (handle.x_m, handle.y_m) == pytest.approx((0.003, 0.0))
    assert handle.clutch
    assert handle.gripper_rad == 0.8


def test_without_a_display_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "x11")
    monkeypatch.delenv("DISPLAY", raising=False)
    with pytest.raises(InputError, match="tis device: mouse: needs a display for its window"):
        open_inputs("mouse")


def test_without_the_extra_it_names_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pygame", None)
    with pytest.raises(
        InputError,
        match=re.escape(f"needs the package pygame-ce: {GET_DEVICE}"),
    ):
        open_inputs("mouse")
