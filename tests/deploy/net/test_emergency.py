"""The command `tis stop` and the live page's buttons against a patient that carries requests out."""

import queue
import shlex
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import zenoh

from tests.common.runtime.live_zenoh import a_router
from tests.deploy.commands import call_in_one_line
from tis.common.messages import encode
from tis.common.node import Arrival, Emission
from tis.common.runtime.emulator_client import EmulatorAddress
from tis.common.runtime.ports import free_endpoints
from tis.common.runtime.signing import SharedSecret, identity
from tis.common.scenario.security import Mtls
from tis.common.signing import SECRETS
from tis.common.stop_messages import LATCH, EmergencyStop, ReleaseRule
from tis.deploy.net import emergency
from tis.deploy.tools.certificates import issue, new_authority
from tis.deploy.view.steering import Steering
from tis.patient_side.safety.emergency_stop import EmergencyStops

pytestmark = pytest.mark.live


class _Patient:
    """Answers requests as the patient does; those on ``deaf_to`` do not reach it, as netem drops them."""

    def __init__(self, session: zenoh.Session, endpoint: str, rule: ReleaseRule, deaf_to: str) -> None:
        self.endpoint, self.stops, self.is_latched = endpoint, EmergencyStops("tis", rule), False
        self._session, self._lock, self._deaf_to = session, threading.Lock(), deaf_to
        self.answering, self.is_here = threading.Lock(), True
        self._heard = [session.declare_subscriber(key, self._take) for key in self.stops.keys]

    def _take(self, sample: zenoh.Sample) -> None:
        if str(sample.key_expr) != self._deaf_to:
            attachment = b"" if sample.attachment is None else sample.attachment.to_bytes()
            self.take(str(sample.key_expr), sample.payload.to_bytes(), attachment)

    def take(self, key: str, payload: bytes, attachment: bytes = b"") -> None:
        with self._lock:
            arrival = Arrival("east", key, payload, attachment, time.monotonic_ns())
            outputs, is_done = self.stops.take(arrival, self.is_latched)
            self.is_latched = self.is_latched and not (is_done and not self.stops.is_stopped)
        for one in outputs:
            with self.answering:  # a session that is used meanwhile cannot be closed
                if isinstance(one, Emission) and self.is_here:
                    self._session.put(one.key, one.payload, attachment=one.attachment or None)

    def foreign_stop(self, number: int, reason: str, lock: str = "") -> None:
        request = EmergencyStop(stop=True, number=number, reason=reason, lock=lock)
        self.take("tis/@tis/stop", encode(request))

    def tis(self, *words: str) -> tuple[int, str, str]:
        return call_in_one_line("stop", *words, "--connect", self.endpoint)


@contextmanager
def _patient(rule: ReleaseRule = "anyone", deaf_to: str = "") -> Iterator[_Patient]:
    endpoint = free_endpoints()[0]
    with a_router(endpoint) as session:
        patient = _Patient(session, endpoint, rule, deaf_to)
        try:
            yield patient
        finally:
            with patient.answering:
                patient.is_here = False


def _stopped(patient: _Patient, reason: str = "") -> str:
    """Stop the arms; return the token."""
    code, out, err = patient.tis(*([reason] if reason else []))
    assert (code, out[:31]) == (0, "stopped, confirmed by the patie"), err
    words = shlex.split(out.split("release it with: tis ")[1])
    assert words[:-1] == ["stop", "--connect", patient.endpoint, "--release"]  # runs as printed
    return words[-1]


def test_each_stop_is_ended_by_its_token_and_the_rest_is_told() -> None:
    with _patient("stopper") as patient:
        one, other = _stopped(patient, "a hand"), _stopped(patient, "smoke")
        code, out, _ = patient.tis("--release", one)
        assert (code, out[:8]) == (0, "released")
        number = other.split("-")[0]
        assert out.endswith(f"; the arms stay stopped by 1 other stop (number {number}: smoke)")
        code, _, err = patient.tis("--release", one)
        assert (code, "is in force: the arms are stopped by 1 stop (" in err) == (2, True), err
        code, _, err = patient.tis("--release", f"{number}-guessed")
        assert (code, f"the secret is not that of stop {number}" in err) == (2, True), err
        code, out, _ = patient.tis("--release", other)
        assert (code, out.endswith(" ms")) == (0, True), out
        assert patient.stops.counters()["releases_by_others"] == 0


def test_without_a_token_all_are_ended_where_anyone_may() -> None:
    with _patient() as patient:
        for number in range(1, 8):  # more than are released in a second
            patient.foreign_stop(number, "")
        _stopped(patient)
        code, out, err = patient.tis("--release")
        assert (code, out[:8], "other" in out) == (0, "released", False), err
        assert (patient.stops.n_releases, patient.stops.n_by_others) == (8, 1)
        code, out, _ = patient.tis("--release")
        assert (code, out[:23]) == (0, "no stop is in force, as")
        patient.is_latched = True
        assert patient.tis("--release")[1][:8] == "released"
        assert not patient.is_latched


def test_without_a_token_what_is_needed_is_told_where_only_the_stopper_may() -> None:
    with _patient("stopper") as patient:
        token = _stopped(patient, "smoke")
        code, _, err = patient.tis("--release")
        number = token.split("-")[0]
        assert (code, f"the arms stay stopped by 1 stop (number {number}: smoke)" in err) == (2, True), err
        assert "patient.safety.release is stopper" in err
        assert patient.stops.is_stopped
        patient.tis("--release", token)
        patient.foreign_stop(5, "no lock\x1b[2J")
        code, _, err = patient.tis("--release")
        assert (code, "(number 5: no lock?[2J)" in err) == (2, True), err
        assert patient.tis("--release", "5")[0] == 0


def test_a_release_that_netem_does_not_pass_on_is_told_with_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(emergency, "TIME_OUT_S", 0.5)
    with _patient("named", deaf_to="tis/@tis/release") as patient:
        token = _stopped(patient)
        for words in (["--release"], ["--release", token]):
            code, _, err = patient.tis(*words)
            assert code == 3
            assert "it hears only the clients in patient.safety.releasers" in err
        assert patient.stops.is_stopped


def test_a_patient_that_answers_others_only_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(emergency, "TIME_OUT_S", 0.5)
    with _patient(deaf_to="tis/@tis/stop") as patient:
        ending = threading.Event()

        def talk() -> None:
            for number in range(1, 1000):
                patient.foreign_stop(number, "another")
                if ending.wait(0.01):
                    return

        talker = threading.Thread(target=talk)
        talker.start()
        code, _, err = patient.tis()
        ending.set()
        talker.join()
    assert code == 3
    assert "did not answer within 0.5 s, but others" in err
    assert "It told last: stopped by " in err


def test_a_signed_runs_stops_are_released_with_the_secret_or_a_certificate_only(tmp_path: Path) -> None:
    secret, other = tmp_path / "secret", tmp_path / "other"
    for file, text in ((secret, "s" * 32), (other, "t" * 32)):
        file.touch(mode=0o600)
        file.write_text(text)
    with _patient() as patient:
        patient.stops.releasers, patient.stops.own = {SECRETS}, SharedSecret(b"s" * 32)
        token = _stopped(patient)  # unsigned, and stops all the same
        for words in (["--release"], ["--release", token], ["--release", token, "--secret-file", str(other)]):
            code, _, err = patient.tis(*words)
            # who has another secret takes no answer for the patient's
            assert (code, "must be signed by one who may release" in err) in ((2, True), (3, False)), err
        assert patient.stops.n_releases == 0
        code, out, err = patient.tis("a hand", "--secret-file", str(secret))
        assert (code, "stopped, confirmed and signed by the patient" in out, f"--secret-file {secret}" in out) == (
            0, True, True,
        ), err  # fmt: skip
        code, out, err = patient.tis("--release", "--secret-file", str(secret))
        assert (code, out[:33]) == (0, "released, confirmed and signed by"), err
        assert (patient.stops.is_stopped, patient.stops.n_unsigned) == (False, 1)

        new_authority(tmp_path / "certs")
        for name in ("patient", "operator"):
            issue(tmp_path / "certs", name)
        own = identity(Mtls(kind="mtls", folder=str(tmp_path / "certs"), sign=True), "patient")
        patient.stops.releasers, patient.stops.own = {"operator"}, own
        operator = ("-c", str(tmp_path / "certs" / "operator" / "zenoh.json5"))
        assert patient.tis("smoke", *operator)[0] == 0
        assert patient.stops.n_unsigned == 1
        code, _, err = patient.tis("--release", "-c", str(tmp_path / "certs" / "patient" / "zenoh.json5"))
        assert (code, "must be signed by" in err) == (2, True), err
        code, out, err = patient.tis("--release", *operator)
        assert (code, out[:33]) == (0, "released, confirmed and signed by"), err


def test_the_live_page_ends_its_own_stops_and_with_anyone_those_of_others() -> None:
    for rule, ends_others in (("anyone", True), ("stopper", False)):
        told: queue.Queue[str] = queue.Queue()
        with _patient(rule) as patient:  # type: ignore[arg-type]
            steering = Steering(EmulatorAddress(patient.endpoint))
            try:
                steering.stop(told.put)
                assert told.get(timeout=60).startswith("stopped, confirmed")
                patient.foreign_stop(7, "smoke", "0" * 64)
                steering.release(told.put)
                answer = told.get(timeout=60)
            finally:
                steering.close()
            assert answer.startswith("released")
            assert ("the arms stay stopped by 1 other stop (number 7: smoke)" in answer) != ends_others
            assert (7 in patient.stops.in_force.by_number) != ends_others


@pytest.mark.parametrize("word", ["0", str(LATCH), "1-", "yes"])
def test_what_is_no_token_is_refused_before_anything_is_sent(word: str) -> None:
    code, _, err = call_in_one_line("stop", "--release", word, "--connect", "tcp/127.0.0.1:1")
    assert (code, "--release: must be a token as tis stop prints it" in err) == (2, True), err
