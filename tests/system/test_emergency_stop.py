"""An emergency stop of a live run, through an outage of both directions."""

import pytest

from common.runtime.free_endpoints import free_endpoints
from tests.deploy.commands import call
from tests.system.conftest import Start

pytestmark = pytest.mark.live
_OUTAGE = "network.timeline=[{at_s: 0.5, for_s: 5, direction: both, set: {outage: true}}]"


def test_a_stop_reaches_the_patient_in_an_outage_from_either_network(start: Start) -> None:
    west, east = free_endpoints()
    words = ("--duration-s", "6", "--set", "estimators=[hold]", "--set", "active_estimator=hold", "--set", _OUTAGE)
    tis = start("run", "default", *words, "--set", f"hosts={{west: {west}, east: {east}}}")
    tis.await_log("patient", 30_000)
    code, out, err = call("stop", "a hand in the way", "--connect", west)
    assert (code, out[:7]) == (0, "stopped"), err
    code, out, err = call("stop", "--release", "--connect", east)
    assert (code, out[:8]) == (0, "released"), err
    code, _, err = call("stop", "--connect", west, "--prefix", "another")
    assert code == 3
    assert "no patient of session another confirmed" in " ".join(err.split())
    code, _, err = tis.wait()
    assert code in (0, 5), err
    assert tis.summary()["safety"]["left"]["emergency_stops"] == 1
    assert tis.summary()["links"]["forward"]["foreign"] == 0
