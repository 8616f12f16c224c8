from deploy.report.tables.drop_reasons import drop_reasons


def test_reasons_stand_with_their_direction_and_nothing_without_any() -> None:
    forward, feedback = {"dropped_by": {"loss": 3, "queue_full": 709}}, {"dropped_by": {"late": 2}}
    assert drop_reasons({"forward": forward, "feedback": feedback}) == (
        " (forward: 3 loss, 709 queue_full; feedback: 2 late)"
    )
    assert drop_reasons({"forward": {"dropped_by": {}}, "feedback": {"dropped_by": None}}) == ""
