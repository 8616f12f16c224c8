from tests.patient_side.orientation.test_no_leak import model
from tis.patient_side.movement_models import WristModel
from tis.patient_side.orientation.methods import build_methods


def test_all_methods_are_built_in_the_order_of_their_names() -> None:
    assert [method.name for method in build_methods(("tangent_ls", "hold"), model())] == ["tangent_ls", "hold"]


def test_without_a_model_the_orientation_is_held() -> None:
    for known in (None, WristModel()):
        assert [method.name for method in build_methods(("tangent_ls", "hold"), known)] == ["hold"]


def test_a_model_serves_the_methods_that_it_has_something_for() -> None:
    assert all(model().serves(name) for name in ("hold", "tangent_ls"))
    assert WristModel().serves("hold")
    assert not WristModel().serves("tangent_ls")
