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
    """Forward sensitivities in SI: d x / d p_k (m, n_x, N), d z / d p_k (m, n_z, N), and how all parameters move with
    the k-th (m, n_p): itself by 1, those under `solve:` as the start requires."""

    names: tuple[str, ...]
    x: Array
    z: Array
    p: Array


@dataclass(frozen=True)
class Result:
    """A run: `time` (N,), states x (n_x, N) and algebraic unknowns z (n_z, N) in SI, and every variable by name.

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
            raise self._unknown(name, problem) from None

    def __getitem__(self, name: str) -> Array:
        return self.signals([name])[name]

    def signals(self, names: Iterable[str]) -> dict[str, Array]:
        """Several signals at once, each (N,); UsageError for a name that is not there."""
        names = list(names)
        expressions = [self._expression(name) for name in names]
        function = ca.Function("signals", list(self.assembly.arguments), [stack(expressions)])
        n = len(self.time)
        values = np.array(function(self.time[None, :], self.x, self.z, np.tile(self.p[:, None], (1, n)), self.u,
                                   np.ones((1, n)))).reshape(len(names), n)
        return {name: self._shown(name, row) for name, row in zip(names, values, strict=True)}

    def sensitivity(self, name: str, parameter: str) -> Array:
        """d signal / d parameter (N,), the signal in the unit of `result[name]`, the parameter in its base unit.

        UsageError unless the run was made with `sensitivities=[parameter]`.
        """
        return self.sensitivities([name], parameter)[name]

    def sensitivities(self, names: Iterable[str], parameter: str) -> dict[str, Array]:
        """The sensitivities of several signals to one parameter; see `sensitivity`."""
        if self.along is None or parameter not in self.along.names:
            raise UsageError([Problem("sensitivity-missing", f"this run has no sensitivities to '{parameter}'", None,
                                      f"simulate(..., sensitivities=['{parameter}'])")])
        names, k, n = list(names), self.along.names.index(parameter), len(self.time)
        t, x, z, p, u, rate = self.assembly.arguments
        stacked = stack([self._expression(name) for name in names])
        dx, dz, dp = (ca.SX.sym("d", a.numel()) for a in (x, z, p))
        moved = sum((ca.jtimes(stacked, a, d) for a, d in ((x, dx), (z, dz), (p, dp)) if a.numel()), ca.SX(len(names), 1))
        function = ca.Function("along", [t, x, z, p, u, rate, dx, dz, dp], [moved])
        values = np.array(function(self.time[None, :], self.x, self.z, np.tile(self.p[:, None], (1, n)), self.u,
                                   np.ones((1, n)), self.along.x[k], self.along.z[k],
                                   np.tile(self.along.p[k][:, None], (1, n)))).reshape(len(names), n)
        shown = self.assembly.model.show
        return {name: row / (read_unit(shown[name].unit).scale if name in shown else 1.0)
                for name, row in zip(names, values, strict=True)}

    def _shown(self, name: str, values: Array) -> Array:
        shown = self.assembly.model.show.get(name)
        return values if shown is None else np.asarray(read_unit(shown.unit).from_si(values))  # type: ignore[arg-type]

    def _expression(self, name: str) -> ca.SX:
        shown = self.assembly.model.show.get(name)
        try:
            return self.assembly.expression(shown.expr if shown is not None else parse_formula(name))
        except ExpressionProblem as problem:
            raise self._unknown(name, problem) from None

    def _unknown(self, name: str, problem: ExpressionProblem) -> UsageError:
        hint = suggest(name, self.names()) or problem.hint
        node, _, member = name.rpartition(".")
        flat = self.assembly.flat
        if member in ("x", "phi") and any(f"{node}.{flow}" in flat.names for flow in ("v", "w")):
            hint = f"No equation uses this position; ask for it: simulate(..., also=['{name}'])."
        return UsageError([Problem(problem.code, problem.message, None, hint)])

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
