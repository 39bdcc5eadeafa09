"""A universal differential equation with symbolic regression (JAX, diffrax, optax; pyoperon), then a fit in simulation.

C. Rackauckas et al., Universal differential equations for scientific machine learning, 2020, arXiv:2001.04385. A neural
network of the across variable and the position is the input at the likeliest place. It is trained to the estimated input
first (see `estimates`), then in simulation together with the free parameters, by gradients through the solver. pyoperon
finds formulas for its values over the motion; those of the Pareto front are fitted in simulation, with their constants free.
If no formula predicts about as well as the network, the network gives the prediction, and the law has no name.
"""

from __future__ import annotations

import os
import re
import time as clock
from collections.abc import Callable, Mapping
from typing import Any

os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1")
import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optax
from pyoperon.sklearn import SymbolicRegressor

from benchmarks.missing_physics.entries.refitting import SHARE, answer_of, scored_record
from benchmarks.missing_physics.entries.terms import effect
from benchmarks.missing_physics.estimates import Estimated, localised
from benchmarks.missing_physics.reading import Array, Case, Record, System, parsed
from benchmarks.missing_physics.scoring import predictions_of
from benchmarks.missing_physics.simulation import AtPlace, Course, Fitted, Simulation

jax.config.update("jax_enable_x64", True)
NAME = "neural network in the equations (UDE), then a formula"
NEEDS = ("jax", "diffrax", "optax", "pyoperon", "scipy")
FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "min": jnp.minimum, "max": jnp.maximum, "abs": jnp.abs, "where": jnp.where, "both": jnp.logical_and,
    "either": jnp.logical_or, "sign": jnp.sign, "sqrt": jnp.sqrt, "exp": jnp.exp, "log": jnp.log, "sin": jnp.sin,
    "cos": jnp.cos, "tan": jnp.tan, "asin": jnp.arcsin, "acos": jnp.arccos, "atan": jnp.arctan, "sinh": jnp.sinh,
    "cosh": jnp.cosh, "tanh": jnp.tanh, "log1p": jnp.log1p, "expm1": jnp.expm1, "floor": jnp.floor, "atan2": jnp.arctan2,
    "hypot": jnp.hypot, "copysign": jnp.copysign}
WIDTH, SAMPLES = 10, 600  # of the hidden layers; samples of each record that the network is trained on
BEFORE, STEPS, RATE, SECONDS = 3000, 300, 0.01, 15.0  # steps of both trainings, step size, processor time of the second (s)
FORMULAS, CONSTANTS = 4, 6  # of the Pareto front that are fitted in simulation; constants that are free in each
NUMBER = re.compile(r"(?<![\w.])\d+\.\d*(?:e[+-]?\d+)?")


class Network:
    """A network of two scaled variables with two hidden layers, in units of the largest estimated input."""

    def __init__(self, estimate: Estimated):
        self.place = estimate.place
        self.sizes = [max(float(np.abs(one).max()), 1e-30) for one in (estimate.across, estimate.position, estimate.value)]

    def start(self) -> list[tuple[Any, Any]]:
        """Random weights, the same each time."""
        keys, widths = jax.random.split(jax.random.PRNGKey(1), 3), (2, WIDTH, WIDTH, 1)
        return [(jax.random.normal(key, (a, b)) * np.sqrt(2 / (a + b)), jnp.zeros(b))
                for key, a, b in zip(keys, widths[:-1], widths[1:], strict=True)]

    def value(self, weights: list[tuple[Any, Any]], v: Any, x: Any) -> Any:
        """The input (SI) at an across variable and a position (SI)."""
        row = jnp.stack([jnp.asarray(v / self.sizes[0]), jnp.asarray(x / self.sizes[1])], axis=-1)
        for matrix, offset in weights[:-1]:
            row = jnp.tanh(row @ matrix + offset)
        return (row @ weights[-1][0] + weights[-1][1])[..., 0] * self.sizes[2]


class Differentiable:
    """A case in JAX: the channels of a record with a law at a place, differentiable by parameters and the law's weights."""

    def __init__(self, case: Case, place: Mapping[str, Any], sizes: Array, loop: bool):
        self.system, self.case, self.place, self.loop = System(case, FUNCTIONS), case, place, loop
        self.sizes = jnp.asarray(sizes)
        self.across = parsed(place["across"], FUNCTIONS)
        self.position = parsed(place["position"], FUNCTIONS) if place["position"] else None
        self.names = list(self.system.free)
        self.low, self.high = (jnp.array([self.system.free[n][k] for n in self.names]) for k in (0, 1))

    def parameters(self, q: Any) -> dict[str, Any]:
        """All parameters with the free ones within their ranges."""
        free = (self.low + self.high) / 2 + (self.high - self.low) / 2 * jnp.tanh(q)
        return {**self.system.parameters, **{name: free[k] for k, name in enumerate(self.names)}}

    def channels(self, record: Record, known: Mapping[str, Any], law: Callable[[Any, Any], Any]) -> Any:
        """The channels (N, channels) in a record."""
        time = jnp.asarray(record.time)
        courses = {name: jnp.asarray(Course(record.time, u, self.case.content["inputs"][name]["interpolation"]).rows)
                   for name, u in record.inputs.items()}
        step = record.time[1] - record.time[0]

        def point(t: Any, s: Any) -> dict[str, Any]:
            k = jnp.clip(((t - record.time[0]) / step).astype(int), 0, len(record.time) - 2)
            h = t - record.time[0] - k * step
            values = {**known, "time": t, **{name: s[i] * self.sizes[i] for i, name in enumerate(self.system.states)}}
            for name, rows in courses.items():
                a, b, c, d = rows[k]
                values[name] = ((a * h + b) * h + c) * h + d
                values[f"der({name})"] = (3 * a * h + 2 * b) * h + c
                values[f"der(der({name}))"], values[f"der(der(der({name})))"] = 6 * a * h + 2 * b, 6 * a
            enters = self.place["enters"]

            def at(w: Any) -> Any:
                signals = self.system.signals({**values, **{node: weight * w for node, weight in enters.items()}})
                return law(self.across(signals), self.position(signals) if self.position else 0.0)

            w = at(jnp.asarray(0.0))
            for _ in range(4 * self.loop):
                after, slope = jax.jvp(at, (w,), (jnp.ones_like(w),))
                w = w - (after - w) / (slope - 1)
            return {**values, **{node: weight * w for node, weight in enters.items()}}

        def slope(t: Any, s: Any, _: Any) -> Any:
            return jnp.stack([jnp.asarray(one, float) for one in self.system.derivatives(point(t, s))]) / self.sizes

        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(slope), diffrax.Kvaerno5(), time[0], time[-1], step, jnp.asarray(self.system.start) / self.sizes,
            saveat=diffrax.SaveAt(ts=time), max_steps=4000, throw=False,
            stepsize_controller=diffrax.PIDController(rtol=1e-4, atol=1e-6, dtmax=20 * step))

        def outputs(t: Any, s: Any) -> Any:
            found = self.system.outputs(point(t, s))
            return jnp.stack([jnp.asarray(found[name], float) for name in self.case.outputs])

        return jax.vmap(outputs)(time, solution.ys)


def descended(loss: Callable[[Any], Any], start: Any, steps: int, rate: float, seconds: float = np.inf) -> Any:
    """The best weights of a descent by Adam."""
    optimizer = optax.adam(optax.cosine_decay_schedule(rate, steps))
    both, state, weights = jax.jit(jax.value_and_grad(loss)), optimizer.init(start), start
    best, least, ends = start, np.inf, clock.process_time() + seconds
    for k in range(steps):
        value, gradient = both(weights)
        if k == 0:
            ends = clock.process_time() + seconds  # after the compilation
        if float(value) < least:
            best, least = weights, float(value)
        finite = all(bool(jnp.all(jnp.isfinite(g))) for g in jax.tree.leaves(gradient))
        if not finite or clock.process_time() > ends:
            break
        change, state = optimizer.update(gradient, state)
        weights = optax.apply_updates(weights, change)
    return best


def trained(case: Case, simulation: Simulation, base: Fitted, estimate: Estimated) -> tuple[Differentiable, Network, Any]:
    """The network at a place and the free parameters, trained in simulation."""
    network = Network(estimate)
    weight = jnp.asarray(1 / (estimate.deviation / np.median(estimate.deviation))**2)
    target, weights = jnp.asarray(estimate.value), network.start()
    across, position = jnp.asarray(estimate.across), jnp.asarray(estimate.position)
    optimizer = optax.adam(optax.cosine_decay_schedule(0.02, BEFORE))

    def step(carry: Any, _: Any) -> Any:
        w, state = carry
        gradient = jax.grad(lambda w: jnp.mean(weight * ((network.value(w, across, position) - target)
                                                         / network.sizes[2])**2))(w)
        change, state = optimizer.update(gradient, state)
        return (optax.apply_updates(w, change), state), None

    weights = jax.jit(lambda w: jax.lax.scan(step, (w, optimizer.init(w)), None, BEFORE)[0][0])(weights)
    records = [r for r in case.records.values() if r.use != "score"]
    states = simulation.run(records[0], base.parameters)
    sizes = np.maximum(np.abs(states).max(axis=0) if states is not None else simulation.size, 1e-6)
    known = simulation.system
    probe = {**known.parameters, "time": 0.0, **dict(zip(known.states, known.start.tolist(), strict=True))}
    for name in records[0].inputs:
        probe.update({name: 0.1, f"der({name})": 0.0, f"der(der({name}))": 0.0, f"der(der(der({name})))": 0.0})
    one = simulation.system.signals({**probe, **dict.fromkeys(estimate.place["enters"], 1e-3)})
    loop = parsed(estimate.place["across"])(one) != parsed(estimate.place["across"])(simulation.system.signals(probe))
    machine = Differentiable(case, estimate.place, sizes, bool(loop))
    short = [Record(r.name, r.use, r.time[:SAMPLES], {k: u[:SAMPLES] for k, u in r.inputs.items()},
                    {k: y[:SAMPLES] for k, y in r.outputs.items()}) for r in records]
    noise = jnp.array([c["noise"] for c in case.outputs.values()])
    measured = [jnp.asarray(np.column_stack(list(r.outputs.values()))) for r in short]

    def loss(both: Any) -> Any:
        q, w = both
        total, count = 2 * jnp.sum(q**2), 0
        for record, y in zip(short, measured, strict=True):
            found = machine.channels(record, machine.parameters(q), lambda v, x: network.value(w, v, x))
            total, count = total + jnp.sum(((found - y) / noise)**2), count + y.size
        return jnp.log(total / count)

    half = np.array([(base.parameters[n] - float(a + b) / 2) / (float(b - a) / 2) for n, a, b in zip(
        machine.names, machine.low, machine.high, strict=True)])
    return machine, network, descended(loss, (jnp.asarray(np.arctanh(np.clip(half, -0.99, 0.99))), weights), STEPS, RATE,
                                       SECONDS)


def formulas(network: Network, weights: Any, estimate: Estimated) -> list[str]:
    """Formulas of X1 = v/v_0 and X2 = x/x_0 for the network's values over the motion, from the Pareto front."""
    value = np.asarray(network.value(weights, jnp.asarray(estimate.across), jnp.asarray(estimate.position)))
    X = np.column_stack([estimate.across / network.sizes[0], estimate.position / network.sizes[1]])
    y, found = value / network.sizes[2], list[tuple[float, int, str]]()
    for symbols in ("add,sub,mul,constant,variable", "add,sub,mul,div,sin,tanh,abs,exp,constant,variable"):
        regressor = SymbolicRegressor(allowed_symbols=symbols, generations=200, population_size=500, pool_size=500,
                                      max_length=20, objectives=["mse", "length"], n_threads=1, random_state=1,
                                      optimizer_iterations=5, max_time=5)
        regressor.fit(X, y)
        for entry in regressor.pareto_front_:
            text = regressor.get_model_string(entry["tree"], 6)
            left = float(np.mean((entry["model"].predict(X) - y)**2) if hasattr(entry["model"], "predict") else
                         entry["mean_squared_error"]) / max(float(np.mean(y**2)), 1e-300)
            found.append((left, len(NUMBER.findall(text)), text))
    found = [f for f in found if np.isfinite(f[0])]
    least = min((left for left, _, _ in found), default=0.0)
    near = sorted((f for f in found if f[0] < max(10 * least, 0.03)), key=lambda f: (f[1], f[0]))
    return list(dict.fromkeys(text for _, _, text in [*near[:FORMULAS - 1], *sorted(found)[:1]]))


def law_of(network: Network, text: str) -> AtPlace:
    """A formula as a law with its constants free, or its amplitude alone if there are many."""
    constants = [float(number) for number in NUMBER.findall(text)]
    if len(constants) > CONSTANTS:
        evaluate, constants = parsed(f"c0*({text})".replace("^", "**")), [1.0]
    else:
        count = iter(range(len(constants)))
        evaluate = parsed(NUMBER.sub(lambda _: f"c{next(count)}", text).replace("^", "**"))

    def value(v: float, x: float, numbers: Any) -> float:
        known = {f"c{k}": float(c) for k, c in enumerate(numbers)}
        return float(evaluate({**known, "X1": v / network.sizes[0], "X2": x / network.sizes[1]})) * network.sizes[2]

    return AtPlace(network.place, value, tuple(constants))


def answer(case: Case) -> dict[str, Any]:
    """The answer by a neural network in the equations."""
    simulation, known = Simulation(case), localised(case)
    base = simulation.fitted()
    if not known.places:
        return answer_of(case, simulation, base, [])
    estimate, scored = known.places[0], scored_record(case)
    machine, network, (q, weights) = trained(case, simulation, base, estimate)
    parameters = {k: float(v) for k, v in machine.parameters(q).items()}
    plain = [(np.asarray(matrix), np.asarray(offset)) for matrix, offset in weights]

    def by_network(v: float, x: float, _: Any) -> float:
        row = np.array([v / network.sizes[0], x / network.sizes[1]])
        for matrix, offset in plain[:-1]:
            row = np.tanh(row @ matrix + offset)
        return float((row @ plain[-1][0] + plain[-1][1])[0]) * network.sizes[2]

    law = AtPlace(estimate.place, by_network)
    records = [r for r in case.records.values() if r.use != "score"]
    squares = 0.0
    for record in records:
        found = simulation.channels(record, {n: parameters[n] for n in machine.names}, law)
        squares += sum(float(np.sum(((found[n] - y) / simulation.noise[n])**2)) for n, y in record.outputs.items()) \
            if found else np.inf
    simulation.ends = clock.process_time() + SECONDS
    trials = []
    for text in formulas(network, weights, estimate):
        try:
            trials.append((simulation.fitted(law_of(network, text), parameters), text))
        except (ArithmeticError, ValueError, KeyError, TypeError):
            continue
    simulation.ends = clock.process_time() + SECONDS
    best = min((fitted.squares for fitted, _ in trials), default=np.inf)
    if squares < best / 1.5 and squares < (1 - SHARE) * base.squares:  # the network is better than its formulas
        free = {n: parameters[n] for n in machine.names}
        across, position, value = simulation.motion(records[0], free, law)
        named = effect(estimate.place, across, position, value, "a neural network")
        channels = simulation.channels(scored, free, law)
        return {"missing": True, "effects": [named | {"class": "", "law": ""}], "chi2_base": base.chi2,
                "input": {"place": estimate.place["nodes"], "values": [float(f"{w:.5g}") for w in value]},
                "predictions": predictions_of(scored.name, channels or {}), "chi2": squares / base.samples}
    return answer_of(case, simulation, base, trials)
