"""What netem needs on its host is found before anything starts anywhere."""

import socket

from tests.deploy.report.hand_made import a_scenario
from tis.common.scenario import reading
from tis.deploy.hosts.input_faults import input_faults


def test_an_endpoint_that_is_taken_is_a_fault_of_netems_host_alone() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        west = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        hosts = {"west": west, "east": "tcp/192.0.2.1:7448?x=1"}
        text = reading.dump_scenario(a_scenario(hosts=hosts))
        assert [fault.where for fault in input_faults("netem", text)] == list(hosts.values())
        assert input_faults("surgeon", text) == []
