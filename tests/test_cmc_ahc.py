"""The assembled compensator against a flat model of the same equations written by hand."""

from __future__ import annotations

import numpy as np
import pytest
import reference_cmc_ahc as reference

import heavebond as hb
from heavebond.basis.units import read_unit
from heavebond.numbers.simulation import Simulator, Tolerances

CASES = {
    "cmc_ahc": reference.ACTIVE,
    "cmc_ahc/passive": reference.PASSIVE,
    "cmc_ahc/active_frictionless": {**reference.ACTIVE, **reference.FRICTIONLESS},
    "cmc_ahc/passive_frictionless": {**reference.PASSIVE, **reference.FRICTIONLESS},
}


@pytest.fixture(scope="module", params=list(CASES))
def run(request: pytest.FixtureRequest) -> tuple[hb.Result, dict[str, np.ndarray]]:
    assembly = hb.assemble(hb.load(request.param))
    # both integrations well below the 1e-6 that is compared
    result = Simulator(assembly, "36 s", every="50 ms", tolerances=Tolerances(1e-10, 1e-12)).run()
    return result, reference.simulate(CASES[request.param], result.time)


@pytest.mark.parametrize("name", reference.OUTPUTS)
def test_every_output_agrees_with_the_flat_model(run: tuple[hb.Result, dict[str, np.ndarray]], name: str) -> None:
    result, flat = run
    unit = read_unit(result.unit(name))
    ours = np.asarray(unit.to_si(result[name]))
    # an output that is zero throughout (the spool in passive mode) is compared on the scale 1 of its unit
    scale = np.abs(flat[name]).max() or 1.0
    assert np.abs(ours - flat[name]).max() <= 1e-6 * scale


def test_the_assembled_model_has_states_only() -> None:
    assembly = hb.assemble(hb.load("cmc_ahc"))
    assert len(assembly.algebraic_names) == 0
    assert assembly.reduced.index == 2
    assert set(assembly.state_names) == {
        "crown.x", "crown.v", "drilling.hook.x", "drilling.hook.v", "drilling.bit.x", "drilling.bit.v",
        "ahc.chamber_a.p", "ahc.chamber_b.p", "ahc.valve.x", "ahc.valve.w", "platform_heave"}


def test_the_start_hangs_in_balance() -> None:
    """The preload found is the weight of all that hangs (163 t) less the 30 kN that stand on the formation."""
    first = hb.simulate(hb.load("cmc_ahc"), 0.1).start
    solved = {line.name: line.used for line in first.table if line.why == "solved for"}
    # 9.80665 m/s2, and the seals and equalisers carry nothing at rest at mid stroke
    assert solved["cmc.gas.F_0"] == pytest.approx(163e3 * 9.80665 - 30e3, rel=1e-3)


@pytest.mark.parametrize("variant", ["irregular_sea", "irregular_sea_passive"])
def test_irregular_sea_runs_and_is_the_same_twice(variant: str) -> None:
    model = hb.load(f"cmc_ahc/{variant}")
    once, again = (hb.simulate(model, "60 s", every="0.1 s") for _ in range(2))
    assert np.array_equal(once["WOB"], again["WOB"])
    assert np.ptp(once["platform"]) > 0.5
