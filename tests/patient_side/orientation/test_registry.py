from tests.patient_side.orientation.test_no_leak import model
from tis.patient_side.movement_models import WristModel
from tis.patient_side.orientation.methods import build_methods


def test_all_methods_are_built_in_the_order_of_their_names() -> None:
    built = build_methods(("tangent_ls", "hold", "constant_rate"), model())
    assert [method.name for method in built] == ["tangent_ls", "hold", "constant_rate"]


def test_without_a_model_the_orientation_is_held() -> None:
    for known in (None, WristModel()):
        assert [method.name for method in build_methods(("tangent_ls", "constant_rate", "hold"), known)] == ["hold"]


def test_a_model_serves_the_methods_that_it_has_something_for() -> None:
    whole = model()
    assert all(whole.serves(name) for name in ("hold", "constant_rate", "tangent_ls"))
    rates = WristModel(whole.rate, whole.gripper_rate)
    assert rates.serves("constant_rate")
    assert not rates.serves("tangent_ls")
    assert [method.name for method in build_methods(("tangent_ls", "constant_rate"), rates)] == ["constant_rate"]
