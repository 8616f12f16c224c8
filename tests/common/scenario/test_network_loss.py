import pytest
from pydantic import TypeAdapter, ValidationError

from tis.common.errors import InputError
from tis.common.scenario.network.loss import Loss
from tis.common.scenario.reading import build_scenario
from tis.netem.stages.loss import expected_loss

LOSS: TypeAdapter[Loss] = TypeAdapter(Loss)
TAIL = {"shape": 3.0, "scale": 2.0}


@pytest.mark.parametrize(
    ("part", "rule"),
    [
        ({"kind": "bernoulli", "p_loss": 1.1}, "less than or equal to 1"),
        ({"kind": "burst", "p_loss": 0.9, "mean_burst": 8}, "mean_burst must be at least p_loss / "),
        ({"kind": "burst", "p_loss": 0.01, "mean_burst": 2001}, "less than or equal to 2000"),
        ({"kind": "burst", "p_loss": 1, "mean_burst": 8}, "less than 1"),
        ({"kind": "gilbert_elliott", "p_bad": 0, "p_good": 0.1}, "greater than or equal to 0.000000001"),
        ({"kind": "four_state", "p13": 0.6, "p14": 0.5, "p31": 0.5}, "p13 \\+ p14 must be at most 1"),
        ({"kind": "four_state", "p13": 0.1, "p31": 0.6, "p32": 0.5}, "p31 \\+ p32 must be at most 1"),
        ({"kind": "four_state", "p13": 0.1, "p31": 0}, "p31 must be at least 1e-09, or a burst never ends"),
        ({"kind": "four_state", "p13": 0.1, "p31": 0.5, "p32": 0.1, "p23": 0}, "p23 must be at least 1e-09"),
        ({"kind": "pareto_runs", "received": TAIL, "lost": {"shape": 1, "scale": 2}}, "greater than 1"),
        ({"kind": "gilbert_pareto", "p_bad": 0.1, "p_good": 0.1, "good": TAIL}, "bad"),
        ({"kind": "trace", "path": ""}, "at least 1 character"),
    ],
)
def test_what_no_loss_can_be_is_refused_with_its_rule(part: dict[str, object], rule: str) -> None:
    with pytest.raises(ValidationError, match=rule):
        LOSS.validate_python(part)


def test_all_faults_are_named_at_once() -> None:
    with pytest.raises(ValidationError) as caught:
        LOSS.validate_python({"kind": "four_state", "p13": 0.9, "p14": 0.9, "p31": 0.9, "p32": 0.9})
    assert "p13 + p14" in str(caught.value)
    assert "p31 + p32" in str(caught.value)


@pytest.mark.parametrize(("p_loss", "mean_burst"), [(0.9, 9), (0.8, 4), (0.99, 99), (0.6, 1.5), (0.999, 999)])
def test_the_least_burst_is_accepted_although_binary_fractions_are_off(p_loss: float, mean_burst: float) -> None:
    """.9 / (1 - .9) is 9.000000000000002."""
    part = LOSS.validate_python({"kind": "burst", "p_loss": p_loss, "mean_burst": mean_burst})
    assert expected_loss(part, {}) == pytest.approx((p_loss, mean_burst), rel=1e-9)
    with pytest.raises(ValidationError, match="mean_burst must be at least"):
        LOSS.validate_python({"kind": "burst", "p_loss": p_loss, "mean_burst": mean_burst * 0.999999})


def test_a_share_of_one_is_refused_in_our_words() -> None:
    raw = {"version": 1, "name": "s", "source": {"kind": "synthetic"}}
    loss = {"kind": "burst", "p_loss": 1, "mean_burst": 3}
    with pytest.raises(InputError) as caught:
        build_scenario(raw | {"network": {"forward": {"loss": loss}}}, "s.yaml")
    assert str(caught.value) == "s.yaml: network.forward.loss.p_loss: must be less than 1 (got 1)"
