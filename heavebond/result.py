"""Time series by name, with units."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from heavebond.dae import Array, Assembly
from heavebond.errors import Problem, UsageError, suggest
from heavebond.expression import ExpressionProblem, parse_formula
from heavebond.initialise import Start
from heavebond.symbols import stack
from heavebond.units import dimension_text, read_unit

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Along:
    """Forward sensitivities in SI: d x / d p_k (m, n_x, N), d z / d p_k (m, n_z, N), how all parameters move with the
    k-th (m, n_p): itself by 1, those under `solve:` as the start requires; and d quadratures / d p_k (m, n_q, N)."""

    names: tuple[str, ...]
    x: Array
    z: Array
    p: Array
    quadratures: Array


@dataclass(frozen=True)
class Result:
    """A run: `time` (N,), states x (n_x, N) and algebraic unknowns z (n_z, N) in SI, and every variable by name;
    `quadratures` (n_q, N) are the integrals that the caller asked for.

    `result["crown.x"]` is in SI; an output under `show:` (`result["pull"]`) is in the unit declared there.
    Any formula of names may be asked for: `result["crown.x - platform.x"]`.
    """

    assembly: Assembly
    time: Array
    x: Array
    z: Array
    u: Array
    p: Array
    start: Start
    statistics: Mapping[str, object] = field(default_factory=dict)
    quadratures: Array = field(default_factory=lambda: np.zeros((0, 0)))
    along: Along | None = None

    def names(self) -> list[str]:
        """Every variable of the diagram and its named outputs."""
        return [*self.assembly.model.show, *self.assembly.flat.names]

    def unit(self, name: str) -> str:
        """The unit in which `result[name]` is given."""
        shown = self.assembly.model.show.get(name)
        if shown is not None:
            return shown.unit
        index = self.assembly.flat.names.get(name)
        if index is not None:
            return self.assembly.flat.unknowns[index].unit.text
        resolver = self.assembly.resolver()
        try:
            return dimension_text(resolver.dimension(parse_formula(name)) or ())
        except ExpressionProblem as problem:
            raise unknown_signal(self.assembly, name, problem) from None

    def __getitem__(self, name: str) -> Array:
        return self.signals([name])[name]

    def signals(self, names: Iterable[str]) -> dict[str, Array]:
        """Several signals at once, each (N,); UsageError for a name that is not there."""
        names = list(names)
        return dict(zip(names, Probe(self.assembly, names).values(self), strict=True))

    def sensitivity(self, name: str, parameter: str) -> Array:
        """d signal / d parameter (N,), the signal in the unit of `result[name]`, the parameter in its base unit.

        UsageError unless the run was made with `sensitivities=[parameter]`.
        """
        if self.along is None or parameter not in self.along.names:
            raise UsageError([Problem("sensitivity-missing", f"this run has no sensitivities to '{parameter}'", None,
                                      f"simulate(..., sensitivities=['{parameter}'])")])
        return np.asarray(Probe(self.assembly, [name]).sensitivities(self)[self.along.names.index(parameter), 0])

    def to_pandas(self, names: Iterable[str] | None = None) -> pd.DataFrame:
        """A table with time as index; by default the named outputs and all unknowns, columns `name [unit]`."""
        import pandas as pd

        chosen = list(names) if names is not None else \
            [*self.assembly.model.show, *(u.name for u in self.assembly.flat.unknowns)]
        columns = {f"{name} [{self.unit(name)}]": values for name, values in self.signals(chosen).items()}
        return pd.DataFrame(columns, index=pd.Index(self.time, name="time [s]"))

    def save(self, path: str | Path, names: Iterable[str] | None = None) -> None:
        """Write a table as .csv or .parquet; UsageError for another suffix."""
        path = Path(path)
        table = self.to_pandas(names)
        if path.suffix == ".csv":
            table.to_csv(path)
        elif path.suffix == ".parquet":
            try:
                table.to_parquet(path)
            except ImportError:
                raise UsageError("writing Parquet needs pyarrow", hint="pip install 'heavebond[parquet]'") from None
        else:
            raise UsageError(f"'{path.name}' has no known suffix", hint="Write .csv or .parquet.")


class Probe:
    """Signals of an assembly as compiled functions, for one run or for many (fitting, sweeps)."""

    def __init__(self, assembly: Assembly, names: Iterable[str]):
        self.names = tuple(names)
        t, x, z, p, u, rate = assembly.arguments
        signals = stack([self._signal(assembly, name) for name in self.names])
        dx, dz, dp = (ca.SX.sym("d", a.numel()) for a in (x, z, p))
        moved = ca.SX(len(self.names), 1)
        for argument, direction in ((x, dx), (z, dz), (p, dp)):
            if argument.numel():
                moved += ca.jtimes(signals, argument, direction)
        self._values = ca.Function("signals", list(assembly.arguments), [signals])
        self._along = ca.Function("along", [t, x, z, p, u, rate, dx, dz, dp], [moved])

    @staticmethod
    def _signal(assembly: Assembly, name: str) -> ca.SX:
        shown = assembly.model.show.get(name)
        try:
            if shown is None:
                return assembly.expression(parse_formula(name))
            unit = read_unit(shown.unit)
            return (assembly.expression(shown.expr) - unit.offset) / unit.scale
        except ExpressionProblem as problem:
            raise unknown_signal(assembly, name, problem) from None

    def values(self, result: Result) -> Array:
        """The signals of a run (n_signals, N)."""
        return np.array(self._values(*columns(result))).reshape(len(self.names), len(result.time))

    def sensitivities(self, result: Result) -> Array:
        """Their derivatives with respect to the parameters of `result.along` (m, n_signals, N)."""
        assert result.along is not None
        n, given = len(result.time), columns(result)
        return np.array([
            np.array(self._along(*given, x, z, np.tile(p[:, None], (1, n)))).reshape(len(self.names), n)
            for x, z, p in zip(result.along.x, result.along.z, result.along.p, strict=True)])


def columns(result: Result) -> tuple[Array, ...]:
    """The arguments of an assembly's functions along a run, one column per time."""
    n = len(result.time)
    return (result.time[None, :], result.x, result.z, np.tile(result.p[:, None], (1, n)), result.u, np.ones((1, n)))


def unknown_signal(assembly: Assembly, name: str, problem: ExpressionProblem) -> UsageError:
    """The error for a signal that is not there; a position that no equation uses must be asked for."""
    flat = assembly.flat
    hint = suggest(name, [*assembly.model.show, *flat.names]) or problem.hint
    node, _, member = name.rpartition(".")
    if member in ("x", "phi") and any(f"{node}.{flow}" in flat.names for flow in ("v", "w")):
        hint = f"No equation uses this position; ask for it: simulate(..., also=['{name}'])."
    return UsageError([Problem(problem.code, problem.message, None, hint)])
