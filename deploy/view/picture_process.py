"""Process that decodes the surgeon's picture for the live page: ``python -m tis.deploy.view.picture_process``.

The first line of its standard input is its options as JSON; each further line asks for the newest picture, once
there is another one than the last. It answers with a line of JSON and the bytes of a JPEG; while there is none, it
says a few times a second that it has looked: on a busy machine it may look late. Nothing waits in it but the messages
of the picture, at most `_MAX_WAITING`: whoever takes no picture gets none, and the run notices neither. It has the
page server's low priority.
"""

import io
import json
import os
import sys
import threading
import time
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import zenoh
from pydantic import ValidationError

from tis.common.channels import VIDEO
from tis.common.errors import EXIT_OK
from tis.common.runtime.meeting import MAX_BYTES
from tis.common.runtime.memory import share_arenas
from tis.common.runtime.zenoh_session import ZenohOptions, open_client, visitor
from tis.common.scenario.control import STATE, EmulatorState, control_prefix
from tis.common.scenario.sight import SightPart
from tis.common.units import NS_PER_S
from tis.deploy.watch.spectator import Shown, Spectator

_MAX_WAITING: Final = 20_000
_ASK_S: Final = 1.0
_LOOK_S: Final = 0.25
_QUALITY: Final = 85


def described(shown: Shown) -> dict[str, Any]:
    """Return what is told of a picture beside its bytes."""
    return {name: value for name, value in shown._asdict().items() if name != "picture"}


def jpeg_of(shown: Shown) -> bytes:
    """Return a picture as JPEG."""
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(shown.picture).save(out, "JPEG", quality=_QUALITY)
    return out.getvalue()


class _Asked:
    """Whether the parent waits for a picture, and whether it is gone."""

    def __init__(self, bell: threading.Event) -> None:
        self.waits = self.is_over = False
        self._bell = bell
        threading.Thread(target=self._read, name="parent", daemon=True).start()

    def _read(self) -> None:
        for _ in sys.stdin:
            self.waits = True
            self._bell.set()
        self.is_over = True
        self._bell.set()


def _sight(session: zenoh.Session, prefix: str, asked: _Asked) -> SightPart | None:
    """Return the video of netem's state, which observers may ask for; waits for a run, None for one without video."""
    key = f"{control_prefix(prefix)}{STATE}"
    while not asked.is_over:
        for reply in session.get(key, timeout=_ASK_S):
            if reply.ok is None or len(reply.ok.payload) > MAX_BYTES:
                continue
            with suppress(ValidationError):
                state = EmulatorState.model_validate_json(reply.ok.payload.to_bytes())
                if state.sight is not None or state.running:
                    return state.sight
        time.sleep(_ASK_S)
    return None


def _tell(content: Mapping[str, Any], data: bytes = b"") -> None:
    sys.stdout.buffer.write(json.dumps({**content, "n_bytes": len(data)}).encode() + b"\n" + data)
    sys.stdout.buffer.flush()


def _follow(session: zenoh.Session, prefix: str, sight: SightPart, bell: threading.Event, asked: _Asked) -> None:
    waiting: deque[tuple[bytes, bytes, int]] = deque(maxlen=_MAX_WAITING)

    def on_sample(sample: zenoh.Sample) -> None:
        attachment = sample.attachment
        if attachment is not None:
            waiting.append((sample.payload.to_bytes(), attachment.to_bytes(), time.monotonic_ns()))
            bell.set()

    listening = session.declare_subscriber(VIDEO.key(prefix), on_sample, allowed_origin=zenoh.Locality.REMOTE)
    spectator, told, looked_ns = Spectator(prefix, sight), 0, 0
    came_ns = time.monotonic_ns()
    while not asked.is_over:
        begun_ns = time.monotonic_ns()
        bell.wait(_LOOK_S)
        bell.clear()
        # what made this thread late holds up the one that hears, too
        late_ns = max(time.monotonic_ns() - begun_ns - int(_LOOK_S * NS_PER_S), 0)
        if len(waiting) == _MAX_WAITING:  # the oldest are gone, which is no loss of the network's
            waiting.clear()
            spectator.restart()
        while waiting:
            before, message = spectator.shown, waiting.popleft()
            spectator.take(*message)
            if spectator.shown is not before:
                came_ns = message[-1]
        shown, now_ns = spectator.shown, time.monotonic_ns()
        looked = {"looked_ns": now_ns - late_ns, "came_ns": came_ns}
        if asked.waits and shown is not None and shown.number > told:
            asked.waits, told = False, shown.number
            _tell(described(shown) | looked, jpeg_of(shown))
        elif asked.waits and now_ns - looked_ns >= _LOOK_S * NS_PER_S:
            looked_ns = now_ns
            _tell(looked)
    listening.undeclare()  # type: ignore[no-untyped-call]


def main() -> int:
    """Decode pictures until standard input is closed; return the exit code."""
    share_arenas()
    options = json.loads(sys.stdin.readline() or "{}")
    if not options:
        return EXIT_OK
    bell = threading.Event()
    asked = _Asked(bell)
    given = options["zenoh"]
    file = None if given["config"] is None else Path(given["config"])
    config = visitor(options["west"], ZenohOptions(config=file, cfg=given["cfg"], credentials=given["credentials"]))
    session = open_client(config, lambda: asked.is_over, lambda: None)
    if session is None:
        return EXIT_OK
    told = options["sight"]
    sight = SightPart.model_validate(told) if told else _sight(session, options["session"], asked)
    if sight is None:
        _tell({"number": 0})
        return EXIT_OK
    try:
        _follow(session, options["session"], sight, bell, asked)
    except ImportError as error:
        _tell({"number": 0, "needs": error.name})
    return EXIT_OK


if __name__ == "__main__":
    code = main()
    # Zenoh's threads may still be releasing callbacks, which aborts a regular end of the interpreter.
    os._exit(code)
