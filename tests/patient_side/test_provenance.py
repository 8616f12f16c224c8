from dataclasses import replace

import numpy as np

from tests.patient_side.arm_models import static_model
from tis.common.scenario import Scenario
from tis.common.scenario.identification import Identification
from tis.common.scenario.reading import build_scenario
from tis.common.sources.provenance import RecordedRows
from tis.common.sources.trajectory import HandRecording, PoseTrack, Recording
from tis.patient_side.provenance import in_sample, models_lacking, warnings_at_start, without_effect
from tis.patient_side.statespace import ArmModel

D002 = RecordedRows("Suturing_D002", "d2", 0, 1240, 30)
E003 = RecordedRows("Suturing_E003", "e3", 0, 2605, 30)


def scenario(train: str) -> Scenario:
    raw = {"version": 1, "name": "s", "source": {"kind": "synthetic"}, "identification": {"train": train}}
    return build_scenario(raw, "s.yaml")


def model(*rows: RecordedRows) -> ArmModel:
    return replace(static_model(), trained_on=rows)


def test_played_rows_that_a_model_was_trained_on_are_said_once() -> None:
    models = (model(D002, E003), replace(model(D002), hand="right"))
    assert in_sample(scenario("m.json"), models, replace(D002, first_row=1000, n_rows=301)) == (
        "in sample: the model of m.json was trained on rows 0-1239 of Suturing_D002, and this run plays rows "
        "1000-1239 of them: its errors are no test of the model",
    )


def test_rows_behind_the_training_and_other_recordings_are_a_test() -> None:
    assert in_sample(scenario("own_head"), [model(D002)], replace(D002, first_row=1240, n_rows=301)) == ()
    assert in_sample(scenario("m.json"), [model(E003)], D002) == ()
    # another recording that goes by the same name
    assert in_sample(scenario("m.json"), [model(replace(E003, label="Suturing_D002"))], D002) == ()
    assert in_sample(scenario("m.json"), [model()], D002) == ()  # a file that does not tell


def test_a_model_that_is_lacking_concerns_only_runs_with_its_estimators() -> None:
    texts = ("no model for paper: moesp_paper finds no state", "no model for tangent_ls: few rows", "something else")
    models = [replace(static_model(), warnings=texts)]
    assert models_lacking(models) == ["paper", "tangent_ls"]
    track = PoseTrack(np.zeros((900, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (900, 1)), np.zeros(900))
    recording = Recording("T", 30, (HandRecording("left", "PSM2", track, track),), 0, "")
    plain = scenario("own_head")
    asked = plain.model_copy(update={"estimators": ("hold", "tis.patient_side.estimators:paper")})
    assert warnings_at_start(plain, recording, models) == texts[1:]
    assert warnings_at_start(asked, recording, models) == texts


def test_what_changes_nothing_beside_a_model_file_is_said() -> None:
    def said(**asked: object) -> tuple[str, ...]:
        return without_effect(Identification.model_validate({"train": "m.json", **asked}), [static_model()])

    ends = "no effect: the model comes from m.json, where it was found by by hand"
    assert said() == ()
    assert said(method="n4sid") == (f"identification.method has {ends}",)
    assert said(method="arx", order=3, train_samples=600) == (
        f"identification.method, identification.train_samples, identification.order have {ends}",
    )
    assert said(order=0) == ()  # what the file's model is
    assert without_effect(Identification(train="m.json", train_samples=900), [model(replace(D002, n_rows=900))]) == ()
    trained = Identification(method="n4sid", train="own_head")
    assert without_effect(trained, [static_model()]) == ()


def test_a_leave_to_look_ahead_that_nothing_takes_is_said() -> None:
    [text] = without_effect(Identification(allow_lookahead=True), ())
    assert text.startswith("identification.allow_lookahead has no effect")
    asked = {"allow_lookahead": True, "inputs": ["position", "velocity"]}
    assert without_effect(Identification.model_validate(asked), ()) == ()
