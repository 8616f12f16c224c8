import pytest

from tests.netem.making import packet, scenario
from tis.common.errors import InputError
from tis.netem.build import build_netem


def test_each_direction_gets_its_pipeline_its_outages_and_the_seed() -> None:
    made = scenario(
        seed=3,
        forward={"delay": {"kind": "constant", "delay_ms": 2}},
        timeline=[{"at_s": 1, "for_s": 1, "direction": "feedback", "set": {"outage": True}}],
    )
    node = build_netem(made)
    for seq in range(2):
        node.receive(packet(1_500_000_000, seq))
        node.receive(packet(1_500_000_000, seq, key="tis/PSM2/estimated_cp", network="east"))
    counters = node.counters()
    assert counters["feedback.dropped.outage"] == 2
    assert counters["forward.dropped.outage"] == 0
    assert node.next_wake_ns() == 1_502_000_000


def test_faults_name_the_scenario() -> None:
    made = scenario(rules=2 * [{"key": "a", "direction": "forward", "pipeline": {}}])
    with pytest.raises(InputError, match=r"^lossy\.yaml: network\.rules\.1\.key: names the same keys as "):
        build_netem(made, where="lossy.yaml")
    with pytest.raises(InputError, match=r"^scenario: "):
        build_netem(made)
