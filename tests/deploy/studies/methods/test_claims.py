from tis.deploy.studies.methods.measured import exponent_text


def test_an_exponent_has_its_interval_if_there_is_one_and_no_negative_zero() -> None:
    assert exponent_text({"exponent": -0.001, "low": -0.012, "high": 0.004}) == "0.00 (-0.01 to 0.00)"
    assert exponent_text({"exponent": 0.894, "low": None, "high": None}) == "0.89"
