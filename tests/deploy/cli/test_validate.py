"""`tis validate` on what stands outside the scenario's file: the traces that its network names, and its rules."""

from pathlib import Path

import pytest

from tests.deploy.commands import call
from tis.deploy.net.profiles import SHIPPED

GOOD = "sent_s,delay_ms\n0,10\n1,12\n"


def _validate(*settings: str) -> tuple[int, str, list[str]]:
    words = [word for setting in settings for word in ("--set", setting)]
    code, out, err = call("validate", "default", *words)
    return code, out, " ".join(err.split()).split("tis: ")[1:]


def _delay(path: Path) -> str:
    return f"network.forward={{delay: {{kind: trace, path: {path}}}}}"


def test_a_trace_that_can_be_read_is_valid(tmp_path: Path) -> None:
    file = tmp_path / "t.csv"
    file.write_text(GOOD)
    code, out, _ = _validate(_delay(file))
    assert code == 0
    assert str(file) in out


@pytest.mark.parametrize(
    ("content", "rule"),
    [
        (None, "does not exist"),
        ("", "sent_s"),
        ("sent_s,delay_ms\n0,-3\n", "delay_ms"),
        ("sent_s,delay_ms\n1,3\n0,3\n", "sent_s"),
    ],
)
def test_a_trace_that_cannot_is_a_line_and_nothing_is_printed(tmp_path: Path, content: str | None, rule: str) -> None:
    file = tmp_path / "t.csv"
    if content is not None:
        file.write_text(content)
    code, out, err = _validate(_delay(file))
    assert (code, out) == (4, "")
    assert len(err) == 1
    assert str(file).replace(" ", "") in err[0].replace(" ", "")
    assert rule in err[0]


def test_all_traces_are_looked_at_wherever_they_stand(tmp_path: Path) -> None:
    """In a loss, in a rule, and in the timeline."""
    names = [tmp_path / f"{name}.csv" for name in "abc"]
    part = "{kind: trace, path: %s}"
    code, _, err = _validate(
        f"network.feedback={{loss: {part % names[0]}}}",
        f"network.rules=[{{key: tis/x, direction: forward, pipeline: {{delay: {part % names[1]}}}}}]",
        f"network.timeline=[{{at_s: 1, set: {{delay: {part % names[2]}}}}}]",
    )
    assert code == 4
    assert len(err) == 3


def test_rules_that_tie_are_refused(tmp_path: Path) -> None:
    rules = ", ".join(f"{{key: {key}, direction: forward, pipeline: {{}}}}" for key in ("tis/*/a", "tis/b/*"))
    code, out, err = _validate(f"network.rules=[{rules}]")
    assert (code, out) == (2, "")
    assert "rules" in err[0]


def test_a_network_of_its_own_is_checked_as_netem_reads_it(tmp_path: Path) -> None:
    file = tmp_path / "net.yaml"
    file.write_text("forward: {delay: {kind: constant, delay_ms: 40}}\n")
    code, out, err = call("validate", str(file), "--set", "feedback.delay.delay_ms=soon")
    assert (code, out) == (2, "")
    assert "--set: feedback.delay.delay_ms" in " ".join(err.split())
    code, out, err = call("validate", str(file), "--set", "forward.delay.delay_ms=50")
    assert code == 0, err
    assert out == "forward:\n  delay:\n    kind: constant\n    delay_ms: 50.0\n"
    assert err.split() == f"{file}: a network: valid; tis netem --scenario-network {file} uses it".split()


@pytest.mark.parametrize(
    ("content", "code", "words"),
    [
        ("forward: {delay: {kind: constnt}}\n", 2, "line 1: forward.delay.kind"),
        ("forward: {delay: {kind: trace, path: none.csv}}\n", 4, "none.csv: does not exist"),
        ("forward: {}\noutages: [{kind: periodic, every_s: 1}]\n", 2, "line 2: outages.0.for_s: is required"),
    ],
)
def test_the_faults_of_a_network_are_told_with_their_lines(
    tmp_path: Path, content: str, code: int, words: str
) -> None:
    file = tmp_path / "net.yaml"
    file.write_text(content)
    found, out, err = call("validate", str(file))
    assert (found, out) == (code, "")
    assert words in " ".join(err.split())
    assert "version" not in err


def test_a_network_alone_below_its_key_is_checked_as_one(tmp_path: Path) -> None:
    """It is what one copies from a scenario, and what netem takes."""
    file = tmp_path / "part.yaml"
    file.write_text("network:\n  forward: {delay: {kind: constant, delay_ms: 40}}\n")
    code, out, err = call("validate", str(file))
    assert code == 0, err
    assert out.startswith("forward:\n")
    assert err.split() == f"{file}: a network: valid; tis netem --scenario-network {file} uses it".split()
    file.write_text("network:\n  forward: {delay: {kind: constant, delay_ms: -1}}\n")
    code, _, err = call("validate", str(file))
    assert code == 2
    assert "line 2: network.forward.delay" in err
    assert "is required" not in err
    file.write_text("network: 5\n")
    code, _, err = call("validate", str(file))
    assert code == 2
    assert "is required" not in err


def test_a_profile_is_checked_as_one(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text((SHIPPED / "wifi_bad.yaml").read_text())
    code, out, err = call("validate", str(file))
    assert code == 0, err
    assert out.startswith("forward:\n")
    assert err.split() == f"{file}: a profile: valid; tis netem --profile {file} uses it".split()
    file.write_text("title: t\nnetwork: {}\n")
    code, _, err = call("validate", str(file))
    assert code == 2
    assert "name: is required" in err
    assert "version" not in err


@pytest.mark.parametrize(
    ("command", "wanted"),
    [
        (("net", "profiles", "FILE"), "profile"),
        (("netem", "--profile", "FILE", "--west", "tcp/127.0.0.1:1", "--east", "tcp/127.0.0.1:2"), "profile"),
        (("twin", "FILE"), "scenario"),
        (("run", "default", "--set", "network.profile=FILE"), "profile"),
    ],
)
def test_a_network_that_stands_for_something_else_is_told_by_its_use(
    tmp_path: Path, command: tuple[str, ...], wanted: str
) -> None:
    file = tmp_path / "net.yaml"
    for text in ("forward: {delay: {kind: constant, delay_ms: 40}}\n", "network: {profile: wifi_bad}\n"):
        file.write_text(text)
        code, _, err = call(*(word.replace("FILE", str(file)) for word in command))
        assert code == 2
        assert f"is a network, not a {wanted}: `tis validate` checks it" in " ".join(err.split())
        assert "is required" not in err
