"""Closed forms of a law of one or two variables, from which formulas are composed.

A form is a sum of terms of a variable u, and of a second variable w, with an amplitude for each term. Besides the amplitudes
it has shape parameters: a scale (in the unit of a variable), a pitch, a threshold, an exponent, a time constant. Every
function is applied to a ratio of two quantities of one unit, so that every formula is consistent in its units: with U and W
the units of the variables, the amplitude of a term of degree (i, j) has the unit of the law over U**i * W**j.

A form with memory adds a differential equation: a first-order lag of a form of u, tau*der(s) = g(u) - s, or a
spring in series with a power law that yields, der(s) = u - u_r*(s/s_0)**n (F. H. Norton, The Creep of Steel at High
Temperatures, 1929).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from heavebond.language.symbols import Context, evaluate
from heavebond.numerics.dae import Array
from heavebond.text.expression import Binary, Call, Expr, Name, Negative, Number, parse_formula

SCALES = np.geomspace(0.03, 3.0, 13)  # of the largest value of a variable
GAPS = np.geomspace(0.03, 3.0, 9)  # of its span, beyond its ends
# Over its span: neighbours differ by an eighth of a turn about the middle. Parts of a period are the soft springs of a
# pendulum or a magnet.
PERIODS = np.concatenate([[0.2, 0.3, 0.4, 0.5, 0.6], np.arange(0.75, 50.0, 0.25)])
QUANTILES = np.linspace(0.1, 0.9, 9)
EXPONENTS = (0.3, 0.5, 0.7, 1.3, 1.5, 1.7, 2.5, 3.5)
LAGS = np.geomspace(2.0, 500.0, 12)  # in sampling intervals
SLIDING = 5e-3  # of the largest speed: the transition of a sign around zero


class Motion(NamedTuple):
    """How a variable moves in the fitted records: its least and largest value, quantiles of its values, and the sampling
    interval (s)."""

    low: float
    high: float
    quantiles: Array
    interval: float

    @property
    def size(self) -> float:
        """Its largest magnitude."""
        return max(abs(self.low), abs(self.high))


@dataclass(frozen=True)
class Shape:
    """A shape parameter: its name in the terms, its description, the variable in whose unit it is (`u`, `w`; `s` for a
    memory, `time`, or none), the values at which it is tried, and its bounds, by the motion of that variable."""

    name: str
    doc: str
    unit: str
    tried: Callable[[Motion], Array]
    bounds: Callable[[Motion], tuple[float, float]]


def _scale(name: str = "u_0", unit: str = "u", doc: str = "scale") -> Shape:
    return Shape(name, doc, unit, lambda m: SCALES * m.size, lambda m: (0.003 * m.size, 100 * m.size))


def _growth(name: str, unit: str) -> Shape:
    """A scale with the sign of the growth."""
    return Shape(name, "scale of the exponential growth", unit,
                 lambda m: np.concatenate([-SCALES[4:], SCALES[4:]]) * m.size, lambda m: (-100 * m.size, 100 * m.size))


def _gap(name: str, unit: str) -> Shape:
    """A value beyond the ends of the motion, at which the law is infinite."""
    return Shape(name, "value at which the law is infinite", unit, lambda m: np.concatenate([
        v for v in (m.high + GAPS * (m.high - m.low), m.low - GAPS * (m.high - m.low)) if np.all(v * v[0] > 0)] or [
            m.high + GAPS * (m.high - m.low)]), lambda m: (-100 * m.size, 100 * m.size))


def _pitch(name: str, unit: str) -> Shape:
    return Shape(name, "pitch", unit, lambda m: (m.high - m.low) / PERIODS,
                 lambda m: ((m.high - m.low) / (1.1 * PERIODS[-1]), 6 * (m.high - m.low)))


THRESHOLD = Shape("u_0", "threshold", "u", lambda m: m.quantiles, lambda m: (m.low, m.high))
LIMIT = Shape("u_0", "value at which the law is infinite", "u", lambda m: m.size + GAPS * m.size,
              lambda m: (1.001 * m.size, 100 * m.size))
EXPONENT = Shape("n", "exponent", "", lambda m: np.array(EXPONENTS), lambda m: (0.1, 8.0))
LAG = Shape("tau", "time constant", "time", lambda m: LAGS * m.interval, lambda m: (m.interval / 5, 1e4 * m.interval))
YIELD = Shape("s_0", "elastic travel at which it yields with the speed u_r", "s",
              lambda m: np.geomspace(3.0, 300.0, 9) * m.interval * m.size, lambda m: (0.1 * m.interval * m.size,
                                                                                   1e4 * m.interval * m.size))
REFERENCE, TRANSITION = "u_r", "u_t"  # fixed: about the largest value of u, and SLIDING times that


@dataclass(frozen=True)
class Term:
    """A term of u, w, shape parameters and the state s of a memory; its unit is the product of the units of u, w and
    the second to the powers in `degree`."""

    text: str
    degree: tuple[int, int, int] = (0, 0, 0)


@dataclass(frozen=True)
class Form:
    """A closed form: its terms, its shape parameters, and the equation of a memory, der(s) = `memory`, on which its terms
    depend then. `first` and `second` are the kinds of variable for which it is meant (empty or
    `any`: any; `second` empty: it has none)."""

    name: str
    terms: tuple[Term, ...]
    shapes: tuple[Shape, ...] = ()
    memory: str = ""
    first: str = ""
    second: str = ""

    @property
    def passive(self) -> bool:
        """Whether its product with u is never negative, for amplitudes and scales above zero: of a rate it dissipates."""
        rate, _, factor = self.name.partition(" times ")
        return rate in PASSIVE and factor in ("", *POSITIVE)

    @property
    def energies(self) -> tuple[str, ...]:
        """The integral of each term over u, if it is known in closed form; empty if not."""
        integrals = tuple(ENERGIES.get(term.text, "") for term in self.terms)
        return integrals if all(integrals) and not self.memory and not self.second else ()

    @property
    def numbers(self) -> int:
        """The number of its parameters."""
        return len(self.terms) + len(self.shapes)


def _one(name: str, text: str, degree: int = 0, *shapes: Shape, first: str = "") -> Form:
    return Form(name, (Term(text, (degree, 0, 0)),), shapes, first=first)


def _gapped(text: str, degree: int, n: int) -> Form:
    return _one(f"{text}/(1 - u/u_0)**{n}", f"{text}/(1 - u/u_0)**{n}", degree, _gap("u_0", "u"))


SINE, COSINE = "sin(2*pi*u/p)", "cos(2*pi*u/p)"
ONE_VARIABLE: tuple[Form, ...] = (
    _one("constant", "1"), _one("line", "u", 1), _one("magnitude", "abs(u)", 1), _one("square", "u**2", 2),
    _one("drag", "u*abs(u)", 2), _one("cube", "u**3", 3), _one("fifth power", "u**5", 5),
    _one("sign", "smooth_sign(u, u_t)", first="across"),
    _one("root", "u/u_r/((u/u_r)**2 + 1e-6)**0.25"),
    _one("power", "u/u_r*((u/u_r)**2 + 1e-6)**((n - 1)/2)", 0, EXPONENT),
    _one("falling sign", "smooth_sign(u, u_t)*exp(-abs(u)/u_0)", 0, _scale(), first="across"),
    _one("soft limit", "u/sqrt(1 + (u/u_0)**2)", 1, _scale()),
    _one("saturation", "tanh(u/u_0)", 0, _scale()), _one("arc tangent", "atan(u/u_0)", 0, _scale()),
    _one("inverse sine", "smooth_sign(u, u_t)*log(abs(u)/u_0 + sqrt(1 + (u/u_0)**2))", 0, _scale()),
    _one("hyperbola", "u/(u_0 + abs(u))", 0, _scale()), _one("peak", "u/u_0/(1 + (u/u_0)**2)", 0, _scale()),
    _one("fading line", "u/u_0*exp(-abs(u)/u_0)", 0, _scale()), _one("bell", "exp(-(u/u_0)**2)", 0, _scale()),
    _one("bell line", "u*exp(-(u/u_0)**2)", 1, _scale()),
    _one("exponential", "exp(u/u_0) - 1", 0, _growth("u_0", "u")),
    _one("exponential line", "u*exp(u/u_0)", 1, _growth("u_0", "u")),
    _one("hyperbolic sine", "(exp(u/u_0) - exp(-u/u_0))/2", 0, _scale()),
    _one("sine", SINE, 0, _pitch("p", "u"), first="position"), _one("cosine", COSINE, 0, _pitch("p", "u"), first="position"),
    Form("wave", (Term(SINE), Term(COSINE)), (_pitch("p", "u"),), first="position"),
    Form("sine and harmonic", (Term(SINE), Term("sin(4*pi*u/p)")), (_pitch("p", "u"),), first="position"),
    Form("wave and harmonic", (Term(SINE), Term(COSINE), Term("sin(4*pi*u/p)"), Term("cos(4*pi*u/p)")),
         (_pitch("p", "u"),), first="position"),
    *(_gapped(text, degree, n) for text, degree in (("1", 0), ("u", 1)) for n in (1, 2, 3)),
    _one("limited extension", "u/(1 - (u/u_0)**2)", 1, LIMIT), _one("limited travel", "u/(1 - abs(u)/u_0)", 1, LIMIT),
    *(_one(f"{text} to the {n}", f"max({text}, 0)**{n}", n, THRESHOLD) for text in ("u - u_0", "u_0 - u")
      for n in (1, 2)),
    *(_one(f"{text} to the 3/2", f"max(({text})/u_r, 0)**1.5", 0, THRESHOLD) for text in ("u - u_0", "u_0 - u")),
    _one("dead zone", "u - min(max(u, -u_0), u_0)", 1, _scale()), _one("limiter", "min(max(u, -u_0), u_0)", 1, _scale()),
)
PASSIVE = frozenset({
    "line", "drag", "cube", "fifth power", "sign", "root", "power", "falling sign", "soft limit", "saturation",
    "arc tangent", "inverse sine", "hyperbola", "peak", "fading line", "bell line", "hyperbolic sine",
    "dead zone", "limiter"})
POSITIVE = frozenset({"w**2", "abs(w)", "max(w, 0)", "exp(w/w_0)"})  # factors that are never negative
ENERGIES = {
    "1": "u", "u": "u**2/2", "u**2": "u**3/3", "u*abs(u)": "abs(u)**3/3", "u**3": "u**4/4", "u**5": "u**6/6",
    SINE: "-p/(2*pi)*cos(2*pi*u/p)", COSINE: "p/(2*pi)*sin(2*pi*u/p)", "sin(4*pi*u/p)": "-p/(4*pi)*cos(4*pi*u/p)",
    "cos(4*pi*u/p)": "p/(4*pi)*sin(4*pi*u/p)", "u/sqrt(1 + (u/u_0)**2)": "u_0**2*(sqrt(1 + (u/u_0)**2) - 1)",
    "exp(u/u_0) - 1": "(u_0*exp(u/u_0) - u)", "(exp(u/u_0) - exp(-u/u_0))/2": "u_0*(exp(u/u_0) + exp(-u/u_0))/2",
    "u*exp(-(u/u_0)**2)": "-u_0**2/2*exp(-(u/u_0)**2)", "1/(1 - u/u_0)**2": "u_0/(1 - u/u_0)",
    "1/(1 - u/u_0)**3": "u_0/2/(1 - u/u_0)**2"}
RATES: tuple[tuple[str, str, int], ...] = (("line", "u", 1), ("drag", "u*abs(u)", 2), ("sign", "smooth_sign(u, u_t)", 0))
FACTORS: tuple[tuple[str, str, int, Shape | None], ...] = (
    ("w", "w", 1, None), ("w**2", "w**2", 2, None), ("abs(w)", "abs(w)", 1, None), ("max(w, 0)", "max(w, 0)", 1, None),
    ("exp(w/w_0)", "exp(w/w_0)", 0, _growth("w_0", "w")),
    *((f"1/(1 - w/w_0)**{n}", f"/(1 - w/w_0)**{n}", 0, _gap("w_0", "w")) for n in (1, 2, 3)),
    ("sin(2*pi*w/p)", "sin(2*pi*w/p)", 0, _pitch("p", "w")), ("cos(2*pi*w/p)", "cos(2*pi*w/p)", 0, _pitch("p", "w")),
)
TWO_VARIABLES = tuple(
    Form(f"{rate} times {factor}", (Term(text + (product if product.startswith("/") else f"*{product}"), (i, j, 0)),),
         () if shape is None else (shape,), first="across", second="position" if "pi" in product else "any")
    for rate, text, i in RATES for factor, product, j, shape in FACTORS)
MEMORY = (
    *(Form(f"lag of {name}", (Term("s"),), (LAG,), f"({text} - s)/tau", first=kind)
      for name, text, kind in (("line", "u/u_r", ""), ("drag", "u*abs(u)/u_r**2", "across"),
                               ("sign", "smooth_sign(u, u_t)", "across"), ("cube", "(u/u_r)**3", "position"))),
    *(Form(f"yielding with exponent {n}", (Term("s", (1, 0, 1)),), (YIELD,), f"u - u_r*(s/s_0)*abs(s/s_0)**{n - 1}",
           first="across") for n in (2, 3, 5)),
)


_FUNCTIONS: dict[str, Callable[..., Array]] = {
    "sin": np.sin, "cos": np.cos, "exp": np.exp, "log": np.log, "sqrt": np.sqrt, "tanh": np.tanh, "atan": np.arctan,
    "abs": np.abs, "max": np.maximum, "min": np.minimum, "smooth_sign": lambda v, v_t: np.tanh(v / v_t)}
_OPERATORS: dict[str, Callable[[Array, Array], Array]] = {
    "+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide, "**": np.power}


def values(text: str, known: Mapping[str, Array | float]) -> Array:
    """A term at values of its names, which broadcast against each other; not finite where it has no value."""
    with np.errstate(all="ignore"):
        return np.asarray(_valued(_parsed(text), {**known, "pi": np.pi}))


_parsed = lru_cache(maxsize=512)(lambda text: parse_formula(text, units=False))


def _valued(expr: Expr, known: Mapping[str, Array | float]) -> Array | float:
    if isinstance(expr, Number):
        return float(expr.value)
    if isinstance(expr, Name):
        return known[expr.text]
    if isinstance(expr, Negative):
        return -_valued(expr.operand, known)
    if isinstance(expr, Binary):
        return _OPERATORS[expr.op](np.asarray(_valued(expr.left, known)), np.asarray(_valued(expr.right, known)))
    assert isinstance(expr, Call)
    return _FUNCTIONS[expr.function](*(_valued(argument, known) for argument in expr.args))


def remembered(memory: str, time: Array, motions: Mapping[str, Array], constants: Mapping[str, Array]) -> Array:
    """The state s (N, m) of a memory from zero on for m choices of its constants (m,), with the variables (N,) between
    their samples as at the middle: implicit midpoint rule, solved by three steps of Newton's method."""
    step = _step(memory, tuple(motions), tuple(constants))
    m = max(np.size(v) for v in constants.values())
    fixed = np.array([np.broadcast_to(np.asarray(v, float), (m,)) for v in constants.values()])
    middle = np.array([(row[1:] + row[:-1]) / 2 for row in (np.asarray(v, float) for v in motions.values())])
    inputs = np.concatenate([np.diff(time)[None], middle])
    accumulated = step.map(m).mapaccum("accumulated", inputs.shape[1])
    states = np.array(accumulated(np.zeros((1, m)), np.repeat(inputs, m, axis=1), np.tile(fixed, (1, inputs.shape[1]))))
    return np.concatenate([np.zeros((1, m)), states.reshape(-1, m)])


@lru_cache(maxsize=64)
def _step(memory: str, motions: tuple[str, ...], constants: tuple[str, ...]) -> ca.Function:
    """A step of the implicit midpoint rule, of s, (h, variables) and constants."""
    symbols = {name: ca.SX.sym(name) for name in (*motions, *constants, "s")}
    context = Context(lambda text, name: symbols[text], lambda value: ca.SX(0))
    slope = evaluate(parse_formula(memory, units=False), context)
    f = ca.Function("f", [*symbols.values()], [slope, ca.jacobian(slope, symbols["s"])])
    s, h = ca.SX.sym("s"), ca.SX.sym("h")
    known, new = [symbols[name] for name in (*motions, *constants)], s
    for _ in range(3):
        value, derivative = f(*known, (s + new) / 2)
        new = new - (new - s - h * value) / (1 - h * derivative / 2)
    return ca.Function("step", [s, ca.vertcat(h, *known[:len(motions)]), ca.vertcat(*known[len(motions):])], [new])
