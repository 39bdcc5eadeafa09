"""The assembled compensator against a flat model of the same equations written by hand."""

from __future__ import annotations

import numpy as np
import pytest
from collected import partly

import heavebond as hb
from benchmarks import reference_cmc_ahc as reference
from heavebond.core.units import read_unit
from heavebond.numerics.initialise import start
from heavebond.numerics.simulator import Simulator, Tolerances

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
    ours = np.asarray(unit.to_si(result.display[name]))
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


@pytest.mark.parametrize("variant", partly(["irregular_sea", "irregular_sea_passive"], 2))
def test_irregular_sea_runs_and_is_the_same_twice(variant: str) -> None:
    model = hb.load(f"cmc_ahc/{variant}")
    once, again = (hb.simulate(model, "60 s", every="0.1 s") for _ in range(2))
    assert np.array_equal(once.display["WOB"], again.display["WOB"])
    assert np.ptp(once["platform"]) > 0.5


@pytest.mark.parametrize("hook", [120, 125, 130, 132.9])
@pytest.mark.parametrize("name", ["cmc_ahc/passive", "cmc_ahc/passive_frictionless", "cmc_ahc/printed_friction_passive"])
def test_a_heavy_hook_has_a_steady_state_though_the_bit_is_off_bottom_at_the_guess(name: str, hook: float) -> None:
    """The string then lengthens so little that the sea floor of the guess is below the bit, where the formation has no
    gradient. By hand: wires carry all but 30 kN, the string what hangs below it, the formation is pressed in by 30 mm."""
    assembly = hb.assemble(hb.load(name)).with_parameters({"drilling.hook.m": 1e3 * hook})
    found = start(assembly, 0.0, np.zeros(assembly.arguments[4].numel()))
    g = 9.81
    bit = -(133e3 * g - 30e3) / 4000e3 - ((133 - hook) * 1e3 * g - 30e3) / 298e3
    assert found.p[assembly.parameter_names.index("drilling.seabed.x0")] == pytest.approx(bit + 0.03, rel=1e-9)


def test_a_weight_on_bit_that_is_not_reached_is_blamed_and_no_chamber() -> None:
    """From a sea floor ten kilometres below; what only follows is not named."""
    given = {"drilling.hook.m": "120 t", "drilling.seabed.x0": "-10 km"}
    assembly = hb.assemble(hb.load("cmc_ahc/passive")).with_parameters(given)
    with pytest.raises(hb.StartError) as caught:
        start(assembly, 0.0, np.zeros(assembly.arguments[4].numel()))
    assert "drilling.formation.N = 30 kN was not reached" in str(caught.value)
    assert "chamber" not in str(caught.value)


def test_the_effects_of_the_flat_model_are_the_laws_that_they_are_named_after() -> None:
    """By definition: thrust and stiffness at mid stroke, two pressure losses in series, air as an ideal gas."""
    p = {**reference.ACTIVE, **reference.FRICTIONLESS, "d": 0.0, "A_eq": 0.0}
    y, preload = np.zeros(11), 1.569e6

    def thrust(s: float, n: float) -> float:
        return reference.passive_forces(-s, 0.0, y, {**p, "n": n}, preload)[0]

    for n in (1.0, 1.3):
        assert thrust(0, n) == pytest.approx(preload)
        assert (thrust(1e-3, n) - thrust(-1e-3, n)) / 2e-3 == pytest.approx(-p["c"], rel=1e-6)
        volume = n * preload / p["c"]      # over the area; F V**n is constant
        assert thrust(2, n) * (volume + 2) ** n == pytest.approx(preload * volume**n)
    lossy = {**p, "K_supply": 5e10, "leak_edge": 0.0, "leak_piston": 0.0}
    y[6], y[7], y[8] = 1.5e7, 1.6e7, 0.4
    flow, _ = reference.chamber_flows(y, lossy)
    edge = (flow / (0.4 * p["q_r"])) ** 2 * p["dp_r"]
    assert edge + 5e10 * flow**2 == pytest.approx(p["p_s"] - 1.5e7, rel=1e-4)     # laminar below 0.1 bar
    airy = {**p, "air": 0.05}
    pressures = 1e7 + np.array([-1e3, 1e3])
    volumes = 1 - pressures / p["beta"] + 0.05 * p["p_0"] / (pressures + p["p_0"])
    assert reference.compressibility(1e7, airy) == pytest.approx(-np.diff(volumes)[0] / 2e3 / volumes.mean(), rel=0.02)
