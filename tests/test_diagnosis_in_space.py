"""The diagnosis of an arm on two joints from records by MuJoCo."""

import pytest

import heavebond as hb


@pytest.mark.slow
def test_the_friction_of_a_joint_is_found() -> None:
    found = hb.diagnose("spatial/pan_tilt_friction", steps=1, classes=["dry friction"], seconds=1800).findings[0]
    assert found.candidate.label.endswith("between tilt_shaft and housing")


@pytest.mark.slow
def test_a_wrong_centre_of_mass_is_found() -> None:
    found = hb.diagnose("spatial/pan_tilt_centre", steps=1, classes=["value of a parameter"], seconds=1800)
    assert any("arm.l_x at 0.27 m" in words for words in found.words)
