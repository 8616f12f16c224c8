"""The models of a run as a table of its report."""

from dataclasses import replace

from tests.deploy.report.hand_made import a_scenario
from tests.patient_side.arm_models import static_model
from tis.deploy.report.subjects.identification import identified, model_table


def test_the_table_tells_how_each_pair_was_found() -> None:
    alone = "MTML -> PSM2 (the table has the hand alone)"
    left = identified(replace(static_model(), pairing=alone), a_scenario())
    right = identified(replace(static_model(), pairing="MTMR -> PSM1 (by the table)"), a_scenario())
    assert model_table({"left": left, "right": right}).note.endswith(f"Pairing: {alone}; MTMR -> PSM1 (by the table)")
