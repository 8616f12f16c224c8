"""Writes ``tis.rbl``, the layout of a run in Rerun's viewer: ``python deploy/rerun/blueprint.py``.

It needs ``pip install rerun-sdk``, which no other part of the testbed does. The layout belongs to the application id
``tis``, under which ``rerun mcap convert --application-id tis`` stores a merged log.
"""

from pathlib import Path
from typing import Final

import rerun.blueprint as layout

APPLICATION_ID: Final = "tis"
_SCENE: Final = ("/psm/**", "/mtm/**", "/plant/**", "/tf/**", "/paths/**", "/estimates/**")


def blueprint() -> layout.Blueprint:
    """Return the layout: the arms and their estimates in space, beside the log and the network's packets."""
    space = layout.Spatial3DView(origin="/", contents=list(_SCENE), name="Arm, estimates and paths")
    log = layout.TextLogView(origin="/log", name="Log")
    packets = layout.DataframeView(origin="/netem/tis", contents="/netem/tis/**", name="What netem decided")
    ticks = layout.DataframeView(origin="/patient/tis/ticks", name="Ticks of the patient")
    beside = layout.Vertical(log, layout.Tabs(packets, ticks))
    return layout.Blueprint(layout.Horizontal(space, beside, column_shares=[3, 2]), collapse_panels=True)


if __name__ == "__main__":
    blueprint().save(APPLICATION_ID, Path(__file__).with_name("tis.rbl"))
