"""Who may end an emergency stop, as a scenario says it."""

from typing import Any

import pytest

from tis.common.errors import InputError
from tis.common.scenario import Scenario
from tis.common.scenario.reading import build_scenario

_LEAST: dict[str, Any] = {"version": 1, "name": "a", "source": {"kind": "synthetic"}}
_MTLS = {"kind": "mtls"}


def _build(safety: dict[str, Any], security: dict[str, Any] | None = None) -> Scenario:
    more = {} if security is None else {"security": security}
    return build_scenario(_LEAST | more | {"patient": {"safety": safety}}, "s.yaml")


@pytest.mark.parametrize("security", [_MTLS, {"kind": "password"}])
def test_names_may_release_where_names_are_proven(security: dict[str, Any]) -> None:
    found = _build({"release": "named", "releasers": ["head_surgeon", "surgeon"]}, security).patient.safety
    assert (found.release, found.releasers) == ("named", ("head_surgeon", "surgeon"))


def test_by_default_anyone_releases() -> None:
    assert _build({}).patient.safety.release == "anyone"
    assert _build({"release": "stopper"}).patient.safety.release == "stopper"


@pytest.mark.parametrize(
    ("safety", "security", "rule"),
    [
        ({"release": "named"}, _MTLS, "patient.safety: releasers must not be empty with release: named"),
        ({"releasers": ["a"]}, _MTLS, "patient.safety: releasers must be empty unless release is named"),
        ({"release": "named", "releasers": ["a"]}, None, "must not be named without security mtls or password"),
        ({"release": "named", "releasers": ["a b"]}, _MTLS, "must be a name of up to 64 letters"),
        ({"release": "nobody"}, None, "patient.safety.release"),
    ],
)
def test_what_does_not_fit_is_refused(safety: dict[str, Any], security: dict[str, Any] | None, rule: str) -> None:
    with pytest.raises(InputError) as refused:
        _build(safety, security)
    (fault,) = refused.value.faults
    assert rule in str(fault).replace("s.yaml: ", "")
