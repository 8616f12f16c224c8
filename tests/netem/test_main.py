"""The emulator of a scenario, as a process of its own."""

import pytest

from common.errors import InputError
from common.runtime.side import SideOptions
from common.runtime.status import Status
from common.runtime.zenoh_session import ZenohOptions
from common.scenario.reading import build_scenario
from netem.__main__ import run_netem


@pytest.mark.parametrize("endpoints", [["tcp/127.0.0.1:0"], ["tcp/127.0.0.1:0"] * 3])
def test_other_than_two_places_to_listen_are_a_mistake_of_the_user(
    endpoints: list[str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    scenario = build_scenario({"version": 1, "name": "s", "source": {"kind": "synthetic"}}, "s.yaml")
    run_dir = tmp_path_factory.mktemp("netem") / "run"
    options = SideOptions(run_dir, ZenohOptions(listen=endpoints))
    with pytest.raises(InputError, match="--listen: must be given twice, west first, then east"):
        run_netem(scenario, options, Status("netem", as_events=False))
    assert not run_dir.exists()
