"""Extended Kalman filter of the states and slowly varying parameters of a machine, with continuous model and sampled
outputs.

The reduced equations with white process noise of states and random walks of parameters q are

    dx = f(t, x, z, q, u) dt + dw,   0 = g(t, x, z, q, u),   dq = dv,   y_k = h(t_k, x, z, q, u) + e_k.

Between two samples the mean follows one or more collocation steps (see `radau_step`), and the covariance of s = (x, q)
follows their exact derivatives, P := Phi P Phi' + Q. At a sample

    e = y - h,   S = H P H' + R,   K = P H' S^-1,   s := s + K e,   P := (I - K H) P (I - K H)' + K R K',

H = h_s - h_z g_z^-1 g_s: algebraic variables follow the states without delay. With S = L L', v = L^-1 e are the normalised
innovations: independent, with unit variance, if the model, the process noise and the noise of the channels are right.
Parameters are counted in standard deviations of their priors (see `localise.ltv_model.Known`), so that a parameter with
positive range is estimated by its logarithm.

A. H. Jazwinski, Stochastic Processes and Filtering Theory, Academic Press 1970, section 8.3; D. Simon, Optimal State
Estimation, Wiley 2006, section 13.2.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from heavebond.core.errors import NAMES_LISTED, Problem, Problems, SimulationError, UsageError, listing, suggest
from heavebond.core.presentation import brief
from heavebond.core.quantities import si_value
from heavebond.core.units import read_unit
from heavebond.estimation.channel_noise import with_noise
from heavebond.estimation.comparison import assemble_for, simulate_over
from heavebond.estimation.experiment import Experiment, ExperimentOrFile, Record, load_experiment
from heavebond.estimation.records import measure
from heavebond.localise.constants import INPUT_ESTIMATION
from heavebond.localise.ltv_model import Known, known_of
from heavebond.monitoring.estimates import StateEstimate
from heavebond.monitoring.radau_step import Point, RadauStep
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.initialise import Start, start, tangent
from heavebond.numerics.inputs import Pieced, pieced
from heavebond.numerics.start_equations import StartEquations


@dataclass(frozen=True)
class FilterConstants:
    """The constants of the state estimation.

    error: error of the integration in the outputs, rms over the noise, up to which the steps are long enough. Origin: its
        square is the share of the innovations that it adds, 1/400. Doubled: 1/100.
    most_steps: most steps between two samples. Origin: a bound on the time. Doubled: slower for machines of high frequency.
    compared: samples of the reference record on which the number of steps is determined. Origin: some periods of most
        motions. Doubled: twice the time at the beginning.
    most_spans: largest standard deviation of an initial state, in spans of the state. Origin: beyond it a linearisation is
        meaningless, and a percentage without its sign is likely. Doubled: nothing.
    """

    error: float = 0.05
    most_steps: int = 64
    compared: int = 1000
    most_spans: float = 10.0


FILTER = FilterConstants()


@dataclass(frozen=True)
class Estimate:
    """The estimate after one sample: states and parameters with their standard deviations (SI), by name, and the normalised
    innovation of each channel that was sampled."""

    time: float
    values: dict[str, float]
    deviations: dict[str, float]
    innovations: dict[str, float]

    @property
    def nis(self) -> float:
        """The normalised innovation squared; chi-square with one degree of freedom for each channel."""
        return sum(v * v for v in self.innovations.values())


@dataclass(frozen=True, eq=False)
class SampledRecord:
    """The samples of a record: time (N,) in s, values (N, m) of the outputs in SI, nan where not sampled, their noise
    (N, m), and the inputs."""

    name: str
    time: Array
    values: Array
    deviations: Array
    inputs: Pieced
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Reference:
    """The properties of the reference record: the span (n,) of each state in nominal sizes, the longest step (s), and the
    number of steps between two samples."""

    span: Array
    longest: float
    steps: int


class Estimator:
    """Extended Kalman filter of the machine of an experiment.

    `walks` maps names of states to the intensity of their process noise, and names of free parameters to the intensity of
    their random walks: the standard deviation after one second, in SI or as text with a unit (`{"load.v": "1 mm/s",
    "valve.q_r": "0 L/min"}`). A parameter with intensity 0 is estimated as a constant; its range under `free:` is the
    prior. States without an intensity have no process noise. `start_deviation` is the standard deviation of the initial
    states, as a share of the span of each state in a run of the `record` (by default the first one of the experiment).

    For a running machine call `step` at every sample. `run` filters a record. Raises UsageError for unknown names, for units
    of another dimension, and for machines with events or delays.
    """

    def __init__(self, experiment: ExperimentOrFile, *, walks: Mapping[str, float | str] | None = None,
                 record: str | None = None, start_deviation: float | str = INPUT_ESTIMATION.start_deviation,
                 reference: Reference | None = None):
        """`reference` is the reference of another estimator of the same record, if one exists."""
        self.experiment = experiment = with_noise(load_experiment(experiment))
        if record is not None and record not in experiment.records:
            raise UsageError([Problem("record-unknown", f"the experiment has no record '{record}'", None,
                                      suggest(record, experiment.records) or f"Records: {listing(experiment.records)}.")])
        self.record = experiment.records[record] if record is not None else next(iter(experiment.records.values()))
        self.assembly: Assembly = assemble_for(experiment, self.record)
        self.share = si_value(start_deviation, "1", "start_deviation")
        if not 0 <= self.share <= FILTER.most_spans:
            raise UsageError([Problem("start-deviation", f"the standard deviation of the start is {self.share:g} times the "
                                      f"span of each state; it must be between 0 and {FILTER.most_spans:g}", None,
                                      "Give a share of the span, for example 0.02 or '50 %'.")])
        self.known, self.noise = _walks(self.assembly, experiment, walks or {})
        self.outputs = list(experiment.outputs)
        self.radau = RadauStep(self.assembly, [self.assembly.expression(o.shown.expr) for o in experiment.outputs.values()],
                               self.known, self.noise)
        self.equations = self.assembly.once("start", lambda: StartEquations(self.assembly))
        self._near: Start | None = None
        self.reference = reference or self._reference()
        self.time: float | None = None
        self._fed: dict[str, float] = {}

    def __repr__(self) -> str:
        return brief(self, self.experiment.name, f"states {listing(self.assembly.state_names, 12)}",
                     f"estimated parameters {listing([k.name for k in self.known], 12)}" if self.known else "",
                     f"outputs {listing(self.outputs, 12)}")

    # -- the recursion ---------------------------------------------------------------------------------------------
    def begin(self, time: float, u: Array) -> None:
        """Begin at the start of the diagram at a time, with the pieces `u` of the inputs."""
        first = self._near = start(self.assembly, time, u, self.equations, self._near)
        values = self.assembly.p[self.radau.places]
        directions = np.zeros((len(first.p), len(self.known)))
        directions[self.radau.places, range(len(self.known))] = [
            prior.slope(v) for prior, v in zip(self.known, values, strict=True)]
        start_slopes = tangent(self.equations, first, u, directions).x / self.assembly.x_nominal[:, None]
        n, k = len(first.x), len(self.known)
        covariance = np.eye(n + k)
        covariance[:n, :n] = start_slopes @ start_slopes.T + np.diag((self.share * self.reference.span) ** 2)
        covariance[:n, n:], covariance[n:, :n] = start_slopes, start_slopes.T
        self.time, self.p = time, first.p
        self.point = Point(first.x / self.assembly.x_nominal, first.z / self.assembly.z_nominal,
                           np.array([prior.place_of(v) for prior, v in zip(self.known, values, strict=True)]), covariance)

    def predict(self, time: float, inputs: Pieced) -> None:
        """Integrate to a time with these inputs."""
        assert self.time is not None
        for begin, h, u in steps_between(self.time, time, inputs, self.reference.longest):
            self.point = self.radau.step(self.point, self.p, u, begin, h)
        self.time = time

    def correct(self, values: Array, deviations: Array, inputs: Pieced) -> tuple[Array, Array]:
        """Use the samples (m,) of the outputs (SI, nan: not sampled) with their noise: the outputs that were predicted, and
        the normalised innovations."""
        assert self.time is not None
        u = inputs.at(np.array([self.time]))[:, 0]
        self.point, predicted, innovations = self.radau.correct(self.point, self.p, u, self.time, values, deviations)
        return predicted, innovations

    # -- a record --------------------------------------------------------------------------------------------------
    def inputs(self, record: Record, begin: float, end: float) -> Pieced:
        """The inputs of a record."""
        flat, sources = self.assembly.flat, self.experiment.inputs_for(record)
        return pieced(replace(flat, inputs=tuple(replace(known, source=sources.get(known.name, known.source))
                                                 for known in flat.inputs)), begin, end)

    def sampled(self, record: Record | None = None) -> SampledRecord:
        """The samples and inputs of a record (by default that of this estimator); DataError for its faults."""
        record = replace(record or self.record, use="test")  # no part of it is held out
        measured = measure(self.experiment, record)
        values, counts, _ = measured.on_grid()
        return SampledRecord(record.name, measured.grid, np.where(counts, values, np.nan).T, measured.deviations.T,
                             self.inputs(record, float(measured.grid[0]), float(measured.grid[-1])), measured.notes)

    def filtered(self, samples: SampledRecord) -> Iterator[tuple[Array, Array]]:
        """The predicted outputs and normalised innovations (m,) of one sample after the other, from the start on."""
        self.begin(float(samples.time[0]), samples.inputs.at(samples.time[:1])[:, 0])
        for i, time in enumerate(samples.time.tolist()):
            if i:
                self.predict(time, samples.inputs)
            yield self.correct(samples.values[i], samples.deviations[i], samples.inputs)

    def run(self, record: Record | None = None) -> StateEstimate:
        """Filter a record with the settings of the record of this estimator (by default that record itself). Raises
        DataError for faults of the record, StartError and SimulationError if the equations cannot be solved."""
        samples = self.sampled(record)
        size = (len(samples.time), len(self.assembly.x_nominal) + len(self.known))
        states, variances = np.empty(size), np.empty(size)
        predicted, innovations = np.empty_like(samples.values), np.empty_like(samples.values)
        for i, (predicted[i], innovations[i]) in enumerate(self.filtered(samples)):
            states[i], variances[i] = np.concatenate([self.point.x, self.point.q]), np.diag(self.point.covariance)
        return self.estimate(samples, states, variances, predicted, innovations)

    def estimate(self, samples: SampledRecord, states: Array, variances: Array, predicted: Array, innovations: Array
                 ) -> StateEstimate:
        """An estimate by names and in SI, from s = (x, q) and its variances (N, n+k)."""
        n = len(self.assembly.x_nominal)
        deviations = np.sqrt(np.maximum(variances, 0))
        names = [*self.assembly.state_names, *(k.name for k in self.known)]
        values = [*(states[:, :n] * self.assembly.x_nominal).T,
                  *(np.array([k.value_of(v) for v in states[:, n + j]]) for j, k in enumerate(self.known))]
        slopes = [*self.assembly.x_nominal,
                  *(np.array([k.slope(v) for v in values[n + j]]) for j, k in enumerate(self.known))]
        by_channel = [dict(zip(self.outputs, part.T, strict=True)) for part in (predicted, samples.values, innovations)]
        return StateEstimate(samples.name, samples.time, dict(zip(names, values, strict=True)),
                             {name: deviations[:, j] * slopes[j] for j, name in enumerate(names)}, self.units,
                             by_channel[0], by_channel[1], by_channel[2], self.reference.steps, samples.notes)

    @property
    def units(self) -> dict[str, str]:
        """The SI unit of each state and estimated parameter."""
        flat = self.assembly.flat
        units = {name: flat.unknowns[j].unit.text for name, (j, _) in zip(self.assembly.state_names,
                                                                          self.assembly.reduced.states, strict=True)}
        return units | {prior.name: flat.parameters[j].unit.text
                        for prior, j in zip(self.known, self.radau.places, strict=True)}

    # -- a running machine -----------------------------------------------------------------------------------------
    def step(self, time: float | str, inputs: Mapping[str, float | str], outputs: Mapping[str, float | str]) -> Estimate:
        """Use one sample of a running machine: its time in s, the inputs and outputs by their names in the experiment, each
        in the unit of its column, or as text with a unit. The first call begins at the start of the diagram. Inputs change
        linearly from sample to sample, or hold their value (`interpolation: hold`). Outputs that are missing or nan are not
        used. Raises UsageError for unknown names, missing inputs, inputs that are not finite, and times that do not rise."""
        problems = Problems()
        declared = self.experiment.inputs_for(self.record)
        time = si_value(time, "s", "time")
        for name in [n for n in inputs if n not in declared]:
            problems.add("input-unknown", f"there is no input '{name}'", hint=suggest(name, declared) or (
                f"Inputs: {listing(list(declared))}." if declared else "The experiment has no inputs."))
        for name in [n for n in declared if n not in inputs]:
            problems.add("input-missing", f"the value of the input '{name}' is missing",
                         hint=f"Inputs: {listing(list(declared))}.")
        for name in [n for n in outputs if n not in self.outputs]:
            problems.add("output-unknown", f"there is no output '{name}'", hint=suggest(name, self.outputs) or NAMES_LISTED)
        if self.time is not None and not time > self.time:
            problems.add("time-order", f"the time {time:g} s is not after the last one, {self.time:g} s",
                         hint="Give samples in the order of time, each once.")
        problems.raise_as(UsageError)
        units = {name: o.shown.unit for name, o in self.experiment.outputs.items()}
        values = np.array([_in_si(outputs[n], units[n], n) if n in outputs else np.nan for n in self.outputs])
        fed = {name: _in_si(inputs[name], f.unit, name, f.factor) for name, f in declared.items()}
        for name in [n for n, value in fed.items() if not np.isfinite(value)]:
            problems.add("input-value", f"the value of the input '{name}' is {fed[name]:g}",
                         hint="Give a finite number; for a missing sample the last value, for example.")
        if not np.isfinite(time):
            problems.add("time-order", f"the time is {time:g} s", hint="Give a finite time in s.")
        problems.raise_as(UsageError)
        held = {name for name, f in declared.items() if f.interpolation == "hold"}
        before = self._fed or fed
        self._fed = fed
        now = self._pieces(time, fed, fed, 1.0)
        if self.time is None:
            self.begin(time, now.columns[:, 0] if now.columns.size else now.at(np.array([time]))[:, 0])
        else:
            step = self._pieces(self.time, before, {n: before[n] if n in held else v for n, v in fed.items()},
                                time - self.time)
            self.predict(time, step)
        noise = self._deviations()
        predicted, v = self.correct(values, noise, now)
        one = self.estimate(SampledRecord("", np.array([time]), values[None], noise[None], now),
                            np.concatenate([self.point.x, self.point.q])[None], np.diag(self.point.covariance)[None],
                            predicted[None], v[None])
        return Estimate(time, {n: float(v[0]) for n, v in one.values.items()},
                        {n: float(v[0]) for n, v in one.deviations.items()},
                        {n: float(x) for n, x in zip(self.outputs, v, strict=True) if np.isfinite(x)})

    def _pieces(self, begin: float, values: Mapping[str, float], then: Mapping[str, float], length: float) -> Pieced:
        """Inputs that go along lines from some values to others."""
        flat = self.assembly.flat
        if not flat.inputs:
            return Pieced(np.zeros(0), np.zeros((0, 0)))
        column = [begin]
        for known in flat.inputs:
            column += [values[known.name], (then[known.name] - values[known.name]) / length, 0.0, 0.0]
        return Pieced(np.array([begin, begin + length]), np.array(column)[:, None])

    def _deviations(self) -> Array:
        """The noise (m,) of the outputs in SI: given, or estimated from the records."""
        noise = []
        for name, output in self.experiment.outputs.items():
            known = self.experiment.estimated_noise.get(name)
            value = output.noise if output.noise is not None else known.deviation if known is not None else np.nan
            noise.append(value * read_unit(output.shown.unit).scale)
        return np.array(noise)

    # -- accuracy --------------------------------------------------------------------------------------------------
    def _reference(self) -> Reference:
        """The spans of the states in a run of the reference record, and the steps of the collocation for which the outputs
        follow this run within a share of the noise."""
        measured = measure(self.experiment, replace(self.record, use="test"))
        run = simulate_over(self.assembly, measured.grid)
        span = np.ptp(run.x, axis=1) / self.assembly.x_nominal
        grid = measured.grid[:FILTER.compared]
        inputs = self.inputs(self.record, float(measured.grid[0]), float(measured.grid[-1]))
        interval = float(np.median(np.diff(measured.grid)))
        noise, q = np.sqrt(np.mean(measured.deviations**2, axis=1)), np.array([
            prior.place_of(v) for prior, v in zip(self.known, self.assembly.p[self.radau.places], strict=True)])
        nothing, unknown = np.full(len(self.outputs), np.nan), np.zeros((len(span) + len(q),) * 2)

        def outputs(point: Point, time: float) -> Array:
            return self.radau.correct(point, run.start.p, inputs.at(np.array([time]))[:, 0], time, nothing, noise)[1]

        exact = [Point(x / self.assembly.x_nominal, z / self.assembly.z_nominal, q, unknown)
                 for x, z in zip(run.x.T[:len(grid)], run.z.T[:len(grid)], strict=True)]
        expected = [outputs(point, time) for point, time in zip(exact, grid.tolist(), strict=True)]
        steps = 1
        while True:
            point, error, longest = exact[0], 0.0, interval / steps
            for i, (begin, end) in enumerate(zip(grid[:-1].tolist(), grid[1:].tolist(), strict=True), 1):
                for at, h, u in steps_between(begin, end, inputs, longest):
                    point = self.radau.step(point, run.start.p, u, at, h)
                error += float(np.mean(((outputs(point, end) - expected[i]) / noise) ** 2))
            if np.sqrt(error / len(grid)) <= FILTER.error:
                return Reference(span, longest, steps)
            if steps >= FILTER.most_steps:
                raise SimulationError([Problem("estimation-accuracy", f"{steps} steps between two samples do not suffice to "
                                               f"follow the run of record '{self.record.name}' within the noise", None,
                                               "The model moves much faster than the record is sampled: leave out the "
                                               "fastest states, or record at a higher rate.")])
            steps *= 2


def steps_between(begin: float, end: float, inputs: Pieced, longest: float) -> Iterator[tuple[float, float, Array]]:
    """Begin, length and pieces of the inputs of each step between two times, equal between breaks of the inputs."""
    for stop in (*inputs.inner_breaks(begin, end).tolist(), end):
        count = max(1, int(np.ceil((stop - begin) / longest * (1 - 1e-9))))
        h = (stop - begin) / count
        u = inputs.at(np.array([begin + h / 2]))[:, 0]
        for i in range(count):
            yield begin + i * h, h, u
        begin = stop


def _in_si(value: float | str, unit: str, subject: str, factor: float = 1.0) -> float:
    """A sample in SI: a number in the unit of its column, which the calibration `factor` multiplies, or text with a unit."""
    if isinstance(value, str):
        return si_value(value, unit, subject)
    return float(read_unit(unit).to_si(value * factor))


def _walks(assembly: Assembly, experiment: Experiment, walks: Mapping[str, float | str]) -> tuple[list[Known], Array]:
    """The priors of the estimated parameters, and the squares of the process noise per second (n+k,): of states in nominal
    sizes, of parameters in units of their q."""
    problems = Problems()
    states = dict(zip(assembly.state_names, assembly.reduced.states, strict=True))
    noise, known, of_known = np.zeros(len(states)), list[Known](), list[float]()
    for name, intensity in walks.items():
        if name in states:
            value = si_value(intensity, assembly.flat.unknowns[states[name][0]].unit.text, name)
            position = list(states).index(name)
            noise[position] = (value / assembly.x_nominal[position]) ** 2
        elif name in experiment.free:
            index = assembly.parameter_indices([name])[0]
            value = si_value(intensity, assembly.flat.parameters[index].unit.text, name)
            prior = known_of(experiment.free[name], float(assembly.p[index]))
            known.append(prior)
            of_known.append((value / prior.slope(float(assembly.p[index]))) ** 2)
        else:
            known_names = [*states, *experiment.free]
            is_parameter = name in assembly.parameter_names
            problems.add("walk-unknown", f"'{name}' is neither a state nor a free parameter", hint=
                         f"Give its range in the experiment: `free: {{{name}: {_example_range(assembly, name)}}}`."
                         if is_parameter else suggest(name, known_names) or f"States: {listing(list(states), 20)}; free "
                         f"parameters: {listing(list(experiment.free) or ['none'], 20)}.")
            continue
        if not (np.isfinite(value) and value >= 0):
            problems.add("walk-negative", f"the process noise of '{name}' is {value:g}: it must be 0 or above",
                         hint="Give the standard deviation after one second.")
    problems.raise_as(UsageError)
    return known, np.concatenate([noise, of_known])


def _example_range(assembly: Assembly, name: str) -> str:
    """A tolerance of a fifth about the value of a parameter, with its unit."""
    index = assembly.parameter_indices([name])[0]
    return f"{assembly.flat.parameters[index].unit.written(float(assembly.p[index]))} +- 20 %"
