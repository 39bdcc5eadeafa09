"""Large machines - a drill string in 500 pieces, a pipe in 200 cells, a hundred cylinders on one supply - each as a diagram
against the same equations in a loop for CasADi."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import casadi as ca
import numpy as np
from numpy.typing import NDArray

import heavebond as hb
from benchmarks import large_by_hand
from benchmarks.large_by_hand import Flat
from benchmarks.measuring import Figure, duration, paired, seconds, spoken
from heavebond.numerics.simulator import Tolerances

Array = NDArray[np.float64]
HERE = Path(__file__).parent
TOLERANCES = Tolerances(1e-6, 1e-8)
PAIRS = 5  # of integrations and of whole ways alike
SETTLE = 12.0  # after so many seconds of calls the equations are compiled


@dataclass(frozen=True)
class Large:
    """A diagram of `size` parts and its equations by hand; `signals` are compared, over the seconds and interval of the
    diagram. `parameter` sets the size, where it is not written out."""

    diagram: str
    what: str
    size: int
    parameter: str
    flat: Callable[[int], Flat]

    def model(self, size: int) -> hb.Model:
        """The diagram at a size."""
        model = hb.load(HERE / f"{self.diagram}.yaml")
        return model.with_parameters({self.parameter: size}) if self.parameter else model

    def simulator(self, size: int, until: float | None = None) -> hb.Simulator:
        """Read, assembled, with an integrator that can run."""
        return hb.Simulator(hb.assemble(self.model(size)), until, tolerances=TOLERANCES)

    def whole(self) -> object:
        """From the file to the end of the run, at the size that is measured."""
        return self.simulator(self.size).run()

    def by_hand(self, flat: Flat, times: Array) -> ca.Function:
        """The integrator of the flat equations."""
        return ca.integrator(self.diagram, "idas", {"x": flat.x, "t": flat.t, "ode": flat.ode}, 0, times[1:].tolist(),
                             {"reltol": TOLERANCES.rtol, "abstol": TOLERANCES.atol, "max_num_steps": 10**6,
                              "linear_solver": "csparse" if flat.x.numel() >= 100 else "qr"})

    def whole_by_hand(self, size: int, times: Array) -> Array:
        """Equations written, integrator built, integrated: the scaled states (n, points)."""
        flat = self.flat(size)
        return np.asarray(self.by_hand(flat, times)(x0=flat.x0)["xf"].full())

    def disagreement(self, size: int, until: float | None = None) -> float:
        """The largest difference of a compared signal, as a share of how far the signal moves."""
        result = self.simulator(size, until).run()
        flat = self.flat(size)
        found = self.whole_by_hand(size, result.time)
        rows = {name: found[k] * flat.sizes[k] for name, k in flat.signals.items()}
        return max(float(np.abs(result.display[name][1:] - row).max() / np.ptp(row)) for name, row in rows.items())


LARGE = (Large("drill_string", "cmc_ahc with its drill string in 500 pieces", 500, "drilling.n", large_by_hand.drill_string),
         Large("line", "a pipe in 200 cells", 200, "pipe.n", large_by_hand.line),
         Large("cylinders", "100 cylinders on one supply", 100, "", large_by_hand.cylinders))


def figures() -> list[Figure]:
    """From the file to the end of the first run, and the integration alone, both against the model by hand."""
    found = []
    for large in LARGE:
        assert large.disagreement(large.size) < 1e-3
        simulator = large.simulator(large.size)
        first = simulator.run()
        flat, times = large.flat(large.size), first.time
        integrator = large.by_hand(flat, times)
        x0, p = first.x[:, 0] / simulator.assembly.x_nominal, simulator.integrand.hoist(first.p, np.zeros((len(first.p), 0)))
        warm = paired(partial(simulator.integrator, x0=x0, p=p), partial(integrator, x0=flat.x0), PAIRS, SETTLE)
        whole = paired(large.whole, partial(large.whole_by_hand, large.size, times), PAIRS)
        found.append(Figure(f"{large.what} ({flat.x.numel()} states): integration / hand-written CasADi", spoken(warm)))
        found.append(Figure(f"{large.what}: read, assemble, start, integrate / build and integrate by hand", spoken(whole)))
        model = large.model(large.size)
        found.append(Figure(f"{large.what}: assembly", duration(seconds(partial(hb.assemble, model)))))
    return found
