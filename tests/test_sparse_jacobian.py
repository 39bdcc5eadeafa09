"""Jacobians of systems with a few full rows: as CasADi's own, by as few sweeps as there can be."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import heavebond as hb
from heavebond.numerics.idas import Tolerances, integrator_options
from heavebond.numerics.simulator import Simulator
from heavebond.numerics.sparse_jacobian import INPUTS, jacobian, rows_backwards

STATIONS = 60  # of two states each, and the supply: above the size from which systems count as large


def supplied(stations: int) -> str:
    """Masses on springs, all of which hang on one body: its balance has a term of each."""
    parts = "".join(f"  spring_{k}: {{is: SpringDamper, c: 1 kN/m, d: {10 + k} N*s/m}}\n"
                    f"  mass_{k}: {{is: Mass, m: {1 + 0.1 * k} kg}}\n" for k in range(stations))
    ends = ", ".join(f"spring_{k}.a" for k in range(stations))
    nodes = "".join(f"  node_{k}: [spring_{k}.b, mass_{k}.a]\n" for k in range(stations))
    return ("model: supplied\ncomponents:\n  body: {is: Mass, m: 100 kg}\n"
            "  drive: {is: ForceSource, u: \"=500 N*sin(pi*time/1 s)\"}\n"
            f"{parts}nodes:\n  body: [body.a, drive.a, {ends}]\n{nodes}simulate: {{until: 1 s, every: 100 ms}}\n")


def test_a_full_row_and_a_full_column_take_one_backward_sweep() -> None:
    n = 40
    x = ca.SX.sym("x", n)
    arrow = ca.vertcat(ca.sum1(x**2), -x[1:] * x[0] - x[1:]**3)
    assert rows_backwards(ca.jacobian_sparsity(arrow, x)).tolist() == [0]
    chain = ca.vertcat(x[1:] - x[:-1], x[0])
    assert not len(rows_backwards(ca.jacobian_sparsity(chain, x)))
    point = np.random.default_rng(1).normal(size=n)
    found, own = (np.array(ca.Function("f", [x], [made(arrow, x)])(point)) for made in (jacobian, ca.jacobian))
    assert found == pytest.approx(own, rel=1e-14, abs=0)


def test_a_large_machine_on_one_body_is_integrated_with_that_jacobian(monkeypatch: pytest.MonkeyPatch) -> None:
    assembly = hb.assemble(hb.loads(supplied(STATIONS)))
    simulator = Simulator(assembly, tolerances=Tolerances(1e-8, 1e-10))
    dae = simulator.integrator._dae
    given = integrator_options(dae, simulator.tolerances, simulator.integrand.smallest_pivot)["cache"]["jacF"]
    own = ca.Function("own", [dae[name] for name in INPUTS], [ca.jacobian(dae["ode"], dae["x"])])
    first = simulator.run()
    p = simulator.integrand.hoist(first.p, np.zeros((len(first.p), 0)))
    point = (0.3, np.random.default_rng(1).normal(size=dae["x"].numel()), [], p, [])
    assert np.array(given(*point)[0]) == pytest.approx(np.array(own(*point)), rel=1e-12, abs=1e-12)
    by_own = hb.simulate(assembly, solver="cvodes")
    monkeypatch.setattr("heavebond.numerics.idas.given_jacobian", lambda dae: {})
    usual = Simulator(assembly, tolerances=Tolerances(1e-8, 1e-10)).run()
    # the same steps but for rounding, to the integrator's tolerances
    assert abs(first.statistics["nsteps"] - usual.statistics["nsteps"]) < 0.05 * usual.statistics["nsteps"]
    for run in (first, by_own):
        assert run.x == pytest.approx(usual.x, abs=1e-6 * float(np.abs(usual.x).max()))
