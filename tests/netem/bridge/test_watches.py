from tests.netem.making import scenario
from tis.common.channels import Network
from tis.netem.bridge.watches import RulesWatch, silent
from tis.netem.link.rules import compile_rules


def test_a_silent_network_is_asked_about() -> None:
    ends: dict[Network, str] = {"west": "tcp/a:1", "east": "tcp/b:2"}
    counters = {"forward.offered": 3, "feedback.offered": 0}
    asks = "nothing came from the east: if its programs send, do they connect to tcp/b:2"
    assert silent(counters, ends, ("**",)) == [f"{asks}?"]
    assert silent(counters, ends, ("a/*", "b")) == [f"{asks}, and on keys that match a/* or b?"]
    counters |= {"feedback.offered": 1}
    assert silent(counters, ends, ("**",)) == []
    [hint] = silent(counters | {"forward.unheard": 1}, ends, ("**",))
    assert hint.startswith("nobody in the east subscribed to what came from the west")
    assert hint.endswith("tcp/b:2")
    for without_subscriber in ("queries.asked", "tokens.changes"):
        assert silent(counters | {"forward.unheard": 1, without_subscriber: 1}, ends, ("**",)) == []


def test_a_rule_that_no_message_matched_is_named() -> None:
    both = [
        {"key": key, "direction": direction, "pipeline": {"loss": {"kind": "bernoulli", "p_loss": 0.1}}}
        for key, direction in (("robot/odom", "feedback"), ("robot/cmd$*", "both"), ("robot/cam/**", "both"))
    ]
    made = scenario(rules=both)
    rules = RulesWatch(compile_rules(made.network, "x", ["robot/**"]))
    rules.match("forward", "robot/odom")  # the rule is of the other direction
    rules.match("forward", "robot/cam/left")
    rules.match("feedback", "robot/scan")
    assert rules.unmatched == {"robot/odom", "robot/cmd$*"}
    ends: dict[Network, str] = {"west": "tcp/a:1", "east": "tcp/b:2"}
    counters = {"forward.offered": 2, "feedback.offered": 1}
    assert silent(counters, ends, ("**",), rules.unmatched) == [
        "rule robot/cmd$*: no message came whose key it matches",
        "rule robot/odom: no message came whose key it matches",
    ]
    # where nothing came at all, that is said alone
    nothing = dict.fromkeys(counters, 0)
    assert not any("rule" in hint for hint in silent(nothing, ends, ("**",), rules.unmatched))
