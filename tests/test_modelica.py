"""Export to Modelica: the text is read by a reader of its own; its equations and `when` clauses hold along runs."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from collected import partly
from modelica_reader import Expression, Scope, read

import heavebond as hb
from heavebond.exchange.modelica import ModelicaExport, modelica
from heavebond.language.library import bundled
from heavebond.language.symbols import stack
from heavebond.numerics.dae import Assembly
from heavebond.numerics.result import Result, columns
from heavebond.numerics.simulator import Simulator

# of the largest term of an equation along the run: the loops of a run are solved to 1e-9 or better
LARGEST_RESIDUAL = 1e-6
POINTS = 25  # of a run at which the equations are evaluated


class Course:
    """The values of all variables of an exported model, and of their derivatives, at points of a run."""

    def __init__(self, exported: ModelicaExport, run: Result):
        self.exported, self.run = exported, run
        self.text = read(exported.text)
        parameters = dict[str, float]()
        for name, value in self.text.bindings.items():
            parameters[name] = value(Scope(parameters))
        self.parameters = parameters
        self.time = 0.0
        self.history: dict[float, tuple[dict[str, float], dict[str, float]]] = {}
        self.functions: dict[int, tuple[ca.Function, list[str], list[str]]] = {}

    def at(self, assembly: Assembly, arguments: Iterable[object]) -> list[tuple[dict[str, float], dict[str, float]]]:
        """Values and rates at points of a run, given as columns of the arguments of the assembly."""
        function, names, rates = self.functions.get(id(assembly)) or self._function(assembly)
        values = np.array(function(*arguments))
        points = []
        for column in values.T:
            known = dict(zip(names, column[:len(names)].tolist(), strict=True))
            rate = dict(zip(rates, column[len(names):].tolist(), strict=True))
            points.append(({**self.parameters, **known}, rate))
        return points

    def delayed(self, source: Expression, length: float) -> float:
        """The source of a `delay()` at an earlier time, and its value at the start for times before it, as the specification
        of Modelica requires."""
        now, self.time = self.time, max(self.time - length, float(self.run.time[0]))
        values, rates = self.history[self.time]
        value = source(Scope(values, rates, arrays=self.text.arrays, delayed=self.delayed))
        self.time = now
        return value

    def with_history(self, points: np.ndarray) -> np.ndarray:
        """Repeat the run with output times at which the sources of the delays are needed at these points of it; the points
        of the new run."""
        run, wanted = self.run, set[float]()

        def collected(source: Expression, length: float) -> float:
            now, self.time = self.time, max(self.time - length, float(run.time[0]))
            wanted.add(self.time)
            near, = self.at(run.assembly, columns(run, np.array([np.searchsorted(run.time, self.time)])))
            value = source(Scope(*near, arrays=self.text.arrays, delayed=collected))  # may be a delay in turn
            self.time = now
            return value

        for values, rates in self.at(run.assembly, columns(run, points)):
            self.time = values["time"]
            scope = Scope(values, rates, arrays=self.text.arrays, delayed=collected)
            for equation in self.text.equations:
                if equation.variable and equation.variable not in values:
                    values[equation.variable] = equation.right(scope)
                else:
                    equation.left(scope), equation.right(scope)
        times = run.time[points]
        self.run = Simulator(run.assembly, times=np.union1d(run.time, [*wanted])).run()
        at = np.searchsorted(self.run.time, [*wanted])
        self.history = dict(zip(wanted, self.at(run.assembly, columns(self.run, at)), strict=True))
        return np.searchsorted(self.run.time, times)

    def _function(self, assembly: Assembly) -> tuple[ca.Function, list[str], list[str]]:
        flat, names, rates = assembly.flat, self.exported.names, dict[str, ca.SX]()
        values = {"time": flat.time, **{names[u.name]: s for u, s in zip(flat.unknowns, flat.levels[0], strict=True)},
                  **{names[h.name]: flat.p[h.index] for h in flat.held}}
        conditions = [e.indicator for e in flat.events if e.indicator is not None]
        occurring = {s.element_hash() for e in (flat.residual_column, *conditions) for s in ca.symvar(e)}
        for k, level in enumerate(flat.levels[1:], 1):
            for u, s in zip(flat.unknowns, level, strict=True):
                lower = names.get(f"der{k - 1 if k > 2 else ''}({u.name})") if k > 1 else names[u.name]
                own = names.get(f"der{k if k > 1 else ''}({u.name})")
                if lower and (own or s.element_hash() in occurring):
                    rates[lower] = s
                    values |= {own: s} if own else {}
        column = assembly.express(stack([*values.values(), *rates.values()]))
        self.functions[id(assembly)] = ca.Function("at", list(assembly.arguments), [column]), list(values), list(rates)
        return self.functions[id(assembly)]


def largest_residual(course: Course) -> tuple[float, str]:
    """The largest residual of an equation along a run, of its largest term, and the equation. A term counts as at least
    1e-6 of the nominal sizes of its variables: at rest all terms of an equation are rounding errors."""
    run, text = course.run, course.text
    points = np.unique(np.linspace(0, len(run.time) - 1, POINTS).astype(int))
    if run.assembly.flat.delays:
        points = course.with_history(points)
        run = course.run
    residuals = np.zeros((len(text.equations), len(points)))
    nominal = {name: float(str(attributes.get("nominal", 1.0))) for name, attributes in text.declared.items()}
    largest = np.array([1e-6 * max((nominal[name] for name in e.names if name in nominal), default=1.0)
                        for e in text.equations])
    for n, (values, rates) in enumerate(course.at(run.assembly, columns(run, points))):
        course.time = values["time"]
        scope = Scope(values, rates, arrays=text.arrays, delayed=course.delayed)
        for k, equation in enumerate(text.equations):
            if equation.variable and equation.variable not in values:  # an auxiliary variable, or an output
                values[equation.variable] = equation.right(scope)
                continue
            left, right = equation.left.parts(scope), equation.right.parts(scope)
            residuals[k, n] = sum(left) - sum(right)
            largest[k] = max(largest[k], *map(abs, (*left, *right)))
    ratios = np.abs(residuals).max(axis=1) / largest
    worst = int(ratios.argmax())
    return float(ratios[worst]), text.equations[worst].comment


def check_events(course: Course) -> int:
    """Compare what the `when` clauses set at the events of a run with the values of the run after them; the number of
    assignments."""
    text, compared = course.text, 0
    events = {e.name: e.text for e in course.run.assembly.flat.events}
    for instant in course.run.instants:
        (before, _), = course.at(instant.assembly, instant.before.values())
        (after, rates), = course.at(instant.assembly, instant.after.values())
        edges = {name: any(text.declared[name]["doc"] == events[e] and name.startswith(_plain(e)) for e in instant.names)
                 for name in text.flags}
        for clause in text.whens:
            if not any(f"{e}: {events[e]}" in clause.comment for e in instant.names):
                continue
            # an event that another one causes at the same instant sees what that one has set
            mine = {name for name, _, _ in clause.assignments}
            part = min(clause.assignments, default=("", None, False))[0].partition("_")[0]
            seen = before if "condition:" not in clause.comment else {
                **before, **{name: after[name] for name, kind in text.kinds.items()
                             if kind == "discrete" and name not in mine and not name.startswith(part)}}
            scope = Scope(after, rates, seen, text.arrays, edges)
            for name, value, _ in clause.assignments:
                size = max(abs(after[name]), abs(before[name]), 1e-12)
                assert value(scope) == pytest.approx(after[name], rel=1e-9, abs=1e-9 * size), (instant.names, name)
                compared += 1
    return compared


def _plain(name: str) -> str:
    return name.replace(".", "_").replace("[", "_").replace("]", "")


def checked(model: hb.Model) -> tuple[Course, int]:
    """Check the equations and events of an exported diagram along its run; the number of assignments of events."""
    exported, run = modelica(model), hb.simulate(model)
    course = Course(exported, run)
    residual, equation = largest_residual(course)
    assert residual < LARGEST_RESIDUAL, equation
    return course, check_events(course)


SHORT = ["quarter_car/quarter_car", "circuits/thermostat", "circuits/tank_level", "mechanisms/slider_crank",
         "examples/half_bridge", "examples/rigid_stop", "examples/lookup2", "examples/discrete_pid",
         "examples/state_machine", "examples/spatial_body"]


@pytest.mark.filterwarnings("ignore::heavebond.RunWarning")
@pytest.mark.parametrize("name", partly(SHORT, 3))
def test_equations_and_events_of_the_text_hold_along_the_run(name: str) -> None:
    course, compared = checked(hb.load(bundled("models") / f"{name}.yaml"))
    assert compared >= len([i for i in course.run.instants if i.time > course.run.time[0]]) // 2


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::heavebond.RunWarning")
def test_every_bundled_diagram_holds_along_its_run_or_its_part_is_named() -> None:
    refused = []
    for path in sorted(bundled("models").rglob("*.yaml")):
        try:
            model = hb.load(path)
        except hb.HeavebondError:  # a component, a study
            continue
        try:
            checked(model)
        except (hb.ModelError, hb.UsageError) as error:
            refused.append((path.stem, error.problems[0].code))
    assert len(refused) < 20
    assert {code for _, code in refused} <= {"export-modelica", "export-function", "fmpy-missing"}, refused


RIG = """
model: rig
components:
  motion: {is: Sine, a: 40 mm, T: 2 s}
  shaker: {is: PositionSource}
  spring: {is: Spring, c: 4 kN/m}
  load:   {is: Mass, m: 100 kg}
nodes:
  motion: [motion.y, shaker.u]
  deck:   [shaker.a, spring.a]
  load:   [spring.b, load.a]
initial: {load.x: 10 mm, load.v: 0 m/s}
show: {load: {is: load.x, unit: mm}}
simulate: {until: 1 s, every: 10 ms}
"""


def test_variables_have_units_start_values_and_the_texts_of_their_components() -> None:
    text = modelica(hb.loads(RIG)).text
    assert '  parameter Real spring_c(unit = "N/m", min = 0) = 4000 "spring.c: stiffness";' in text
    assert '  Real load_x(unit = "m", start = 0.01, fixed = true, stateSelect = StateSelect.prefer) "load.x: ' in text
    assert '  load_m*der(load_v) = load_a_f "load: m * der(a.v) = a.f";' in text
    assert '  Real show_load(unit = "m", displayUnit = "mm") "load: load.x";' in text
    assert "StopTime = 1," in text


def test_a_signal_input_becomes_an_input_of_the_model() -> None:
    exported = modelica(hb.loads(RIG), ["shaker.u"])
    assert [q.name for q in exported.inputs] == ["input_shaker_u"]
    assert '  input Real input_shaker_u(unit = "m", start = 0) "shaker.u";' in exported.text


def test_a_table_is_a_pair_of_arrays_and_a_sum_over_their_elements() -> None:
    points = 12
    text = modelica(hb.loads(f"""
model: table
components:
  table: {{is: Lookup, u: "=time/(1 s)", x: {[*range(points)]}, v: {[k * k for k in range(points)]}}}
show: {{y: {{is: table.y, unit: 1}}}}
simulate: {{until: 10 s, every: 1 s}}
""")).text
    assert f"  parameter Real table_v[{points}](" in text
    assert f"for i in 1:{points - 1})" in text


def test_a_delay_is_the_operator_of_modelica_and_keeps_the_value_of_the_source() -> None:
    """A delay of a delay, of a source that starts at 1: the second one is at its value at the start for 0.7 s."""
    course, _ = checked(hb.loads("""
model: late
components: {motion: {is: Sine, a: 1, T: 2 s}, shifted: {is: Gain, k: 1, u: =1 + motion.y}, late: {is: Delay, T: 0.3 s},
             later: {is: Delay, T: 0.4 s}}
nodes: {u: [shifted.y, late.u], v: [late.y, later.u]}
show: {y: {is: later.y, unit: 1}}
simulate: {until: 2 s, every: 10 ms}
"""))
    assert "late_d = delay(u, late_T)" in course.exported.text
    assert min(course.history) == 0


def test_a_record_is_an_array_of_cubic_pieces(tmp_path: Path) -> None:
    times = np.linspace(0, 1, 11)
    (tmp_path / "r.csv").write_text("time,u\n" + "".join(f"{t},{t**2}\n" for t in times))
    (tmp_path / "m.yaml").write_text("""
model: replay
components: {lag: {is: FirstOrderLag, T_1: 0.1 s, u: {file: r.csv, column: u, unit: 1, interpolation: spline,
  time: {column: time, unit: s}}}}
show: {y: {is: lag.y, unit: 1}}
simulate: {until: 1 s, every: 10 ms}
""")
    course, _ = checked(hb.load(tmp_path / "m.yaml"))
    assert "piecewise(time, record_time, record_lag_u)" in course.exported.text


@pytest.mark.parametrize(("name", "part"), [("circuits/pile_driver", "'soil'"), ("examples/locking_clutch", "'part'")])
def test_a_part_that_a_when_clause_cannot_express_is_named(name: str, part: str) -> None:
    with pytest.raises(hb.ModelError, match=part) as caught:
        modelica(hb.load(bundled("models") / f"{name}.yaml"))
    assert caught.value.problems[0].code == "export-modelica"


def test_a_run_without_inputs_has_columns_at_some_of_its_times() -> None:
    """The empty matrix of its inputs has as many columns as the others, otherwise no function takes them."""
    run = hb.simulate(hb.loads(RIG), "20 ms")
    assert {np.shape(column)[1] for column in columns(run, np.array([0, 2]))} == {2}
