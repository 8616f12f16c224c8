"""The rights on paper; tests/system/test_security attacks real routers with them."""

from typing import Any

import pytest
import zenoh

from tis.common.channels import Network
from tis.common.scenario.security import Mtls, NoSecurity, Password
from tis.netem.bridge.access import access_control

MTLS = Mtls(kind="mtls", control=("operator",), observers=("watcher",))


def _may(config: dict[str, Any], subject: str, kind: str, key: str) -> bool:
    """Decide as Zenoh documents it: deny before allow, then the default."""
    [rules] = [policy["rules"] for policy in config["policies"] if subject in policy["subjects"]]
    found = {
        rule["permission"]
        for rule in config["rules"]
        if rule["id"] in rules and kind in rule["messages"] and "ingress" in rule["flows"]
        if any(zenoh.KeyExpr(each).includes(zenoh.KeyExpr(key)) for each in rule["key_exprs"])
    }
    return "deny" not in found and ("allow" in found or config["default_permission"] == "allow")


@pytest.mark.parametrize(
    ("network", "subject", "kind", "key", "may"),
    [
        ("west", "side", "put", "tis/MTML/measured_cp", True),
        ("west", "side", "put", "tis/PSM2/setpoint_cp", True),
        ("west", "side", "put", "tis/PSM2/estimated_cp", False),
        ("west", "side", "put", "other/MTML/measured_cp", False),
        ("west", "side", "put", "tis/@tis/end", False),
        ("west", "side", "liveliness_token", "tis/@tis/run/surgeon/1-2-0123456789abcdef", True),
        ("west", "side", "liveliness_token", "tis/@tis/run/netem/1-2-0123456789abcdef", False),
        ("east", "side", "liveliness_token", "tis/@tis/run/surgeon/1-2-0123456789abcdef", False),
        ("west", "side", "put", "tis/netem/control/outage", False),
        ("west", "side", "query", "tis/netem/control/outage", False),
        ("west", "side", "query", "tis/@tis/clock", True),
        ("west", "side", "declare_queryable", "tis/@tis/clock", False),
        ("west", "side", "query", "tis/@tis/scenario/netem", True),
        ("west", "side", "query", "tis/@tis/scenario/patient", False),
        ("west", "side", "declare_queryable", "tis/@tis/scenario/surgeon", True),
        ("west", "side", "reply", "tis/@tis/scenario/surgeon", True),
        ("west", "side", "declare_queryable", "tis/@tis/scenario/netem", False),
        ("west", "side", "reply", "tis/@tis/scenario/netem", False),
        ("east", "side", "reply", "tis/@tis/scenario/surgeon", False),
        ("west", "observers", "query", "tis/@tis/scenario/netem", False),
        ("west", "side", "liveliness_token", "tis/@tis/side/surgeon/0123", True),
        ("west", "side", "liveliness_token", "tis/@tis/side/patient/0123", False),
        ("west", "side", "liveliness_token", "tis/@tis/mirror/patient/0123", False),
        ("east", "side", "put", "tis/PSM2/estimated_cp", True),
        ("east", "side", "put", "tis/MTML/measured_cp", False),
        ("east", "side", "liveliness_token", "tis/@tis/side/patient/0123", True),
        ("west", "observers", "declare_subscriber", "tis/MTML/measured_cp", True),
        ("west", "observers", "query", "tis/netem/control/state", True),
        ("west", "observers", "query", "tis/netem/control/outage", False),
        ("west", "observers", "put", "tis/MTML/measured_cp", False),
        ("east", "control", "query", "tis/netem/control/outage", True),
        ("east", "control", "put", "tis/netem/control/reset", True),
        ("east", "control", "put", "tis/PSM2/estimated_cp", False),
        ("west", "side", "put", "tis/@tis/stop", True),
        ("west", "control", "put", "tis/@tis/stop", True),
        ("west", "observers", "put", "tis/@tis/stop", False),
        ("west", "side", "put", "tis/@tis/release", True),
        ("east", "control", "put", "tis/@tis/release", True),
        ("west", "observers", "put", "tis/@tis/release", False),
        ("west", "side", "put", "tis/@tis/stopped", False),
        ("east", "side", "put", "tis/@tis/stopped", True),
        ("east", "side", "put", "tis/PSM2/servo_cp", True),
        ("east", "control", "put", "tis/PSM2/servo_cp", False),
        ("west", "side", "put", "tis/PSM2/servo_cp", False),
        ("east", "side", "declare_subscriber", "tis/PSM2/servo_cp", True),
        ("west", "side", "put", "tis/PSM2/predicted_cp", True),
        ("west", "control", "put", "tis/PSM2/predicted_cp", False),
        ("east", "side", "put", "tis/PSM2/predicted_cp", False),
        ("west", "observers", "declare_subscriber", "tis/PSM2/predicted_cp", True),
        ("east", "side", "put", "tis/PSM2/arm/measured_cp", True),
        ("east", "side", "declare_subscriber", "tis/PSM2/arm/measured_cp", True),
        ("east", "observers", "put", "tis/PSM2/arm/measured_cp", False),
        ("east", "side", "declare_subscriber", "tis/PSM2/measured_cp", True),
        ("east", "side", "declare_subscriber", "tis/PSM2/estimated_cp", False),
        ("east", "side", "put", "tis/ECM/video", True),
        ("west", "side", "put", "tis/ECM/video", False),
        ("west", "side", "declare_subscriber", "tis/ECM/video", True),
        ("west", "side", "put", "tis/PSM2/arm/measured_cp", False),
        ("west", "side", "put", "device/MTML/measured_cp", False),
        ("east", "observers", "declare_subscriber", "tis/PSM2/servo_cp", True),
        ("west", "side", "declare_subscriber", "tis/@tis/stopped", True),
        ("east", "side", "declare_subscriber", "tis/@tis/stop", True),
        ("east", "side", "declare_subscriber", "tis/@tis/release", True),
    ],
)
def test_each_name_says_what_is_its_own(network: Network, subject: str, kind: str, key: str, may: bool) -> None:
    assert _may(access_control(MTLS, "tis", network), subject, kind, key) == may


@pytest.mark.parametrize(
    ("kind", "key", "may"),
    [
        ("liveliness_token", "tis/@tis/run/netem/1-2-0123456789abcdef", False),
        ("liveliness_token", "tis/@tis/run/surgeon/1-2-0123456789abcdef", True),
        ("put", "tis/@tis/end", False),
        ("declare_queryable", "tis/@tis/clock", False),
        ("liveliness_token", "tis/@tis/side/netem/0123", False),
        ("liveliness_token", "tis/@tis/mirror/surgeon/0123", False),
        ("liveliness_token", "tis/@tis/side/surgeon/0123", True),
        ("put", "tis/MTML/measured_cp", True),
        ("query", "tis/netem/control/outage", True),
    ],
)
def test_without_security_netems_own_words_are_still_netems(kind: str, key: str, may: bool) -> None:
    for network in ("west", "east"):
        assert _may(access_control(NoSecurity(kind="none"), "tis", network), "anybody", kind, key) == may


@pytest.mark.parametrize("key", ["tis/@tis/stopped", "tis/PSM2/servo_cp", "tis/PSM1/servo_cp"])
def test_without_security_what_the_patient_says_is_not_said_on_the_surgeons_network(key: str) -> None:
    config = {network: access_control(NoSecurity(kind="none"), "tis", network) for network in ("west", "east")}
    assert not _may(config["west"], "anybody", "put", key)
    assert _may(config["east"], "anybody", "put", key)
    assert _may(config["west"], "anybody", "put", "tis/@tis/stop")
    assert _may(config["west"], "anybody", "put", "tis/@tis/release")


@pytest.mark.parametrize("network", ["west", "east"])
def test_with_releasers_nobody_else_releases_and_who_could_stop_still_can(network: Network) -> None:
    config = access_control(MTLS, "tis", network, releasers=["head_surgeon"])
    others = ["control", "netem", *(["side"] if network == "west" else [])]
    assert {each: _may(config, each, "put", "tis/@tis/release") for each in ["releasers", *others]} == {
        "releasers": True, **dict.fromkeys(others, False),
    }  # fmt: skip
    assert all(_may(config, each, "put", "tis/@tis/stop") for each in ["releasers", *others])
    assert not _may(config, "observers", "put", "tis/@tis/stop")
    assert _may(config, "releasers", "declare_subscriber", "tis/@tis/stopped")
    assert not _may(config, "releasers", "put", "tis/MTML/measured_cp")
    assert not _may(config, "releasers", "query", "tis/netem/control/outage")


def test_without_security_no_prediction_is_said_on_the_patients_network() -> None:
    config = {network: access_control(NoSecurity(kind="none"), "tis", network) for network in ("west", "east")}
    assert not _may(config["east"], "anybody", "put", "tis/PSM2/predicted_cp")
    assert _may(config["west"], "anybody", "put", "tis/PSM2/predicted_cp")


def test_names_are_proven_as_the_scenario_says() -> None:
    subjects = {one["id"]: one for one in access_control(MTLS, "tis", "west")["subjects"]}
    assert subjects["side"]["cert_common_names"] == ["surgeon"]
    assert subjects["control"]["cert_common_names"] == ["operator"]
    by_password = access_control(Password(kind="password"), "tis", "east")
    subjects = {one["id"]: one for one in by_password["subjects"]}
    assert subjects["side"]["usernames"] == ["patient"]
    assert subjects.keys() == {"side", "netem"}, "nobody is listed"
    assert by_password["default_permission"] == "deny"


def test_a_device_speaks_with_the_surgeons_name_on_the_surgeons_network() -> None:
    key = "device/MTML/measured_cp"
    config = access_control(MTLS, "tis", "west", [key])
    assert _may(config, "side", "put", key)
    assert _may(config, "side", "declare_subscriber", key)
    assert not _may(config, "observers", "put", key)
    assert not _may(config, "control", "put", key)
    assert not _may(config, "side", "put", "device/MTMR/measured_cp")
    # the live page of the run is a client of netem's own, and may be the device
    assert _may(config, "netem", "put", key)
    assert _may(config, "netem", "declare_subscriber", key)
    assert not _may(config, "netem", "put", "device/MTMR/measured_cp")
