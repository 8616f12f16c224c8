"""The three sides together: all run until all have ended, and an end that ends the others."""

import asyncio
from collections.abc import Callable
from typing import Any, Final

from common.channels import Side
from common.errors import EXIT_OK
from deploy.hosts.side_watch import SideWatch
from deploy.shell.outcome import SideEnd

_OTHERS_END_S: Final = 2.5


async def watch_all(
    watches: dict[Side, SideWatch], bell: asyncio.Event, tolerates_failures: Callable[[], bool]
) -> dict[Side, SideEnd]:
    """Return the ends of all sides. Ctrl-C ends them; so does a failed one, unless the run tolerates that."""
    sides = {asyncio.create_task(watch.run()): side for side, watch in watches.items()}
    rung = asyncio.create_task(bell.wait())
    ending: list[asyncio.Task[None]] = []
    ends: dict[Side, SideEnd] = {}

    def end_all(delay_s: float) -> None:
        if not ending:
            ending.extend(asyncio.create_task(_interrupt(watch, delay_s)) for watch in watches.values())

    try:
        while len(ends) < len(sides):
            waiting: list[asyncio.Task[Any]] = [task for task, side in sides.items() if side not in ends]
            waiting += [] if rung.done() else [rung]
            done, _ = await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
            ends |= {side: task.result() for task, side in sides.items() if task in done}
            if rung in done:
                for later in ending:
                    later.cancel()
                ending.clear()
                end_all(0)
            elif any(end.exit_code != EXIT_OK for end in ends.values()) and not tolerates_failures():
                end_all(_OTHERS_END_S)  # they see it themselves and say why they end
    finally:
        left: list[asyncio.Task[Any]] = [*sides, rung, *ending]
        for task in left:
            task.cancel()
        await asyncio.gather(*left, return_exceptions=True)
    return ends


async def _interrupt(watch: SideWatch, delay_s: float) -> None:
    watch.is_ending = True
    await asyncio.sleep(delay_s)
    await watch.interrupt()
