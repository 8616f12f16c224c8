"""What the page about networks shows works."""

import json
import re
from pathlib import Path
from typing import Any, get_args

import pytest
import yaml

from tests.netem.making import link
from tis.common.channels import Direction
from tis.common.scenario.control import Operation
from tis.common.scenario.network import NetworkPart
from tis.deploy.net.library.stage_reference import EXAMPLE, REQUESTS, network_page, sections
from tis.netem.control.control import Control
from tis.netem.link.link import Link

GUIDE = Path(__file__).parents[4] / "docs" / "emulator" / "describe_network.md"


def test_the_example_has_everything_that_changes_and_is_valid() -> None:
    network = NetworkPart.model_validate(yaml.safe_load(EXAMPLE))
    assert network.states is not None
    assert [len(part) for part in (network.rules, network.outages, network.timeline)] == [2, 1, 1]


def _control() -> Control:
    links: dict[Direction, Link] = {way: link(way) for way in get_args(Direction)}
    return Control(links)


@pytest.mark.parametrize(("operation", "request_"), REQUESTS)
def test_the_requests_shown_are_accepted(operation: str, request_: Any) -> None:
    answer, _ = _control().handle(operation, json.dumps(request_).encode(), 2_000_400_000)
    assert answer.accepted, answer.reasons


def test_every_operation_is_shown() -> None:
    assert {operation for operation, _ in REQUESTS} == set(get_args(Operation))


def test_the_requests_and_stages_of_the_manual_are_those_of_the_emulator() -> None:
    text = network_page() + GUIDE.read_text(encoding="utf-8")
    shown = re.findall(r"^tis/netem/control/(\w+) +(\{.*\})$", text, re.MULTILINE)
    assert {operation for operation, _ in shown} == set(get_args(Operation))
    for operation, request in shown:
        answer, _ = Control(_control().links, _library).handle(operation, request.encode(), 2_000_400_000)
        assert answer.accepted, answer.reasons
    (loss,) = [section for section in sections() if section.name == "loss"]
    assert all(f"`{kind.name}`" in GUIDE.read_text(encoding="utf-8") for kind in loss.kinds)


def test_the_guide_s_networks_are_valid() -> None:
    blocks = re.findall(r"```yaml\n(.*?)```", GUIDE.read_text(encoding="utf-8"), re.DOTALL)
    networks = [raw for raw in map(yaml.safe_load, blocks) if "rules" in raw]
    assert networks
    for raw in networks:
        NetworkPart.model_validate(raw)


def _library(name: str) -> dict[str, Any]:
    return {"forward": {"delay": {"kind": "constant", "delay_ms": 1}}}
