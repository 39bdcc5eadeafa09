"""What is hidden in the records of the study: an effect, its law in another formulation where there is one, and how its
numbers follow from one amplitude."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from heavebond.language.edits import Change, Part
from heavebond.numerics.dae import Array

Draw = Mapping[str, float]
Path = Callable[[float, Draw], Mapping[str, float]]


@dataclass(frozen=True)
class Truth:
    """`label` names the catalogue's candidate that is hidden; `law` is a component in its place, `change` another diagram
    altogether. `path(a, drawn)` gives its numbers (by the name behind the dot; SI) at the amplitude a, first tried at
    `first` and at most `most`; `shapes` are drawn uniformly, in logarithms above zero. `filter(t, y, a, drawn)` is what a
    sensor or a drive does to a signal. Right answers besides the label's own: `also`, pairs of class and where."""

    name: str
    label: str = ""
    path: Path = lambda a, drawn: {}
    first: float = 1.0
    most: float = np.inf
    shapes: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    law: str = ""
    change: Change | None = None
    owner: str = ""
    filter: Callable[[Array, Array, float, Draw], Array] | None = None
    also: tuple[tuple[str, tuple[str, ...]], ...] = ()

    @property
    def outside(self) -> bool:
        """Whether the catalogue lacks it."""
        return not self.label


def one(key: str, sign: float = 1.0) -> Path:
    """The amplitude is the number."""
    return lambda a, drawn: {key: sign * a, **{k: v for k, v in drawn.items() if k != "sign"}}


# -- signals: the law of each sensor or drive, written for samples ------------------------------------------------------
def offset(t: Array, y: Array, a: float, drawn: Draw) -> Array:
    return np.asarray(y + a * np.sign(drawn["sign"] - 0.5))


def gain(t: Array, y: Array, a: float, drawn: Draw) -> Array:
    return np.asarray(y * (1 + a * np.sign(drawn["sign"] - 0.5)))


def delay(t: Array, y: Array, a: float, drawn: Draw) -> Array:
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(t, y)(np.maximum(t - a, t[0])))


def lag(t: Array, y: Array, a: float, drawn: Draw) -> Array:
    """Exact for an input that is linear between the samples."""
    found, h = y.copy(), t[1] - t[0]
    keep = np.exp(-h / a)
    for k in range(1, len(y)):
        slope = (y[k] - y[k - 1]) / h
        found[k] = y[k] - a * slope + keep * (found[k - 1] - y[k - 1] + a * slope)
    return found


def dead_band(t: Array, y: Array, a: float, drawn: Draw) -> Array:
    return np.asarray(np.sign(y) * np.maximum(np.abs(y) - a, 0))


def saturation(t: Array, y: Array, a: float, drawn: Draw) -> Array:
    """Cuts the share a of the range of the training record at the top, and half as much at the bottom."""
    span = drawn["high"] - drawn["low"]
    return np.clip(y, drawn["low"] + 0.5 * a * span, drawn["high"] - a * span)


def rate_limit(t: Array, y: Array, a: float, drawn: Draw) -> Array:
    """No faster than the share 1 - a of the largest rate of the training record."""
    found, most = y.copy(), (1 - a) * drawn["rate"] * (t[1] - t[0])
    for k in range(1, len(y)):
        found[k] = found[k - 1] + np.clip(y[k] - found[k - 1], -most, most)
    return found


FILTERS = {"SensorOffset": (offset, 1.0, np.inf), "SensorGain": (gain, 0.02, 0.5), "Delay": (delay, 0.05, 2.0),
           "FirstOrderLag": (lag, 0.05, 5.0), "DeadBand": (dead_band, 1.0, np.inf),
           "Saturation": (saturation, 0.1, 0.45), "RateLimit": (rate_limit, 0.2, 0.95)}


def signals(chosen: Mapping[str, str], size: Mapping[str, float]) -> list[Truth]:
    """One for each kind and place (`before vessel.u`, `in the channel crown.x`); `size` is that of each signal."""
    found = []
    for kind, where in chosen.items():
        filtered, first, most = FILTERS[kind]
        scale = 0.02 * size[where] if kind in ("SensorOffset", "DeadBand") else 1.0
        found.append(Truth(f"{kind} {where}", f"{kind} {where}", first=first * scale, most=most, filter=filtered,
                           shapes={"sign": (0.0, 1.0)}))
    return found


# -- the receiver ------------------------------------------------------------------------------------------------------
PRESSURE, OPENING = "in the channel receiver.p", "before inlet.u"
GAS = {PRESSURE: 4e5, OPENING: 0.5}
RECEIVER = [
    Truth("choked inlet", "PneumaticValve in inlet (b_cr)", one("b_cr"), 0.2, 0.65),
    Truth("leak in", "PneumaticOrifice between supply and receiver", one("C"), 2e-10),
    Truth("polytropic", "Receiver in receiver (n)", lambda a, drawn: {"n": 1 + a}, 0.1, 0.5),
    Truth("inlet line", "PneumaticLine between supply and inlet.a", one("R"), 1e7,
          also=(("line resistance", ("receiver", "inlet")),)),
    Truth("outlet line", "PneumaticLine between receiver and outlet.a", one("R"), 1e7,
          also=(("line resistance", ("air", "outlet")),)),
    Truth("warm receiver", "ReceiverWithHeat in place of receiver", lambda a, drawn: {"G": 30 / a}, 1.0, 300.0),
    Truth("choked outlet", "PneumaticOrifice in outlet (b_cr)", one("b_cr"), 0.3, 0.65),
    Truth("leak out", "PneumaticOrifice between receiver and air", one("C"), 6e-10),
    *signals({"SensorOffset": PRESSURE, "Delay": OPENING, "Saturation": OPENING}, GAS),
    Truth("breathing leak", change=Change({"leak": Part("BreathingLeak")}, {"receiver": ("+leak.a",), "air": ("+leak.b",)}),
          owner="leak", path=one("C"), first=1e-10, also=(("leakage", ("receiver", "air")),)),
    *signals({"SensorGain": PRESSURE, "FirstOrderLag": OPENING, "DeadBand": OPENING, "RateLimit": OPENING}, GAS),
    *signals({"SensorGain": OPENING, "FirstOrderLag": PRESSURE, "Saturation": PRESSURE}, GAS),
    *signals({"SensorOffset": OPENING, "Delay": PRESSURE, "RateLimit": PRESSURE}, GAS)]

# -- the passive rig ---------------------------------------------------------------------------------------------------
INNER = ("platform", "crown")
HEAVE, PULL, RISE, REACH = "before vessel.u", "in the channel string.F", "in the channel crown.x", "in the channel extension"
RIG = {HEAVE: 0.5, PULL: 3e4, RISE: 0.15, REACH: 0.5}
BETWEEN = "between platform and crown"
PASSIVE = [
    Truth("Coulomb", f"CoulombFriction {BETWEEN}", one("F_c"), 3e3, law="StiffBristle"),
    Truth("Stribeck", f"StribeckFriction {BETWEEN}", one("F_c"), 3e3, law="StiffBristle",
          shapes={"r": (1.3, 2.0), "v_s": (0.02, 0.1), "x_s": (2e-5, 5e-4)}),
    Truth("cubic spring", f"CubicSpring {BETWEEN}", lambda a, drawn: {"c_3": a, "l0": 0.0}, 2e3),
    Truth("drag", f"Drag {BETWEEN}", one("d_2"), 1e4, law="RoundedDrag"),
    Truth("end stop", f"EndStop {BETWEEN}", lambda a, drawn: {"c": a, "x_min": -0.55, "x_max": 0.6}, 2e4, law="HertzStop"),
    Truth("hysteresis", f"Hysteresis {BETWEEN}", one("F_h"), 3e3, shapes={"x_y": (0.02, 0.1), "n": (1.0, 2.0)}),
    Truth("gas spring", "PolytropicSpring in place of gas", one("kappa"), 0.1, 0.8),
    Truth("added mass", "Mass on crown", one("m"), 5e3),
    Truth("string compliance", "SeriesCompliance between crown and string.b", lambda a, drawn: {"c": 4e6 / a}, 1.0, 30.0,
          also=(("series compliance", ("seabed", "string")),)),
    Truth("slack string", "SlackWire in place of string", lambda a, drawn: {"k": a, "s_0": -0.05}, 0.1, 1.0),
    Truth("position friction", change=Change({"x": Part("PositionFriction")}, {"platform": ("+x.a",), "crown": ("+x.b",)}),
          owner="x", path=one("F_c"), first=3e3, also=(("dry friction", INNER),)),
    Truth("guide friction", "CoulombFriction between seabed and crown", one("F_c"), 3e3, law="StiffBristle"),
    Truth("string play", "SpringDamperWithPlay in place of string", one("gap"), 2e-3, 0.05,
          also=(("backlash", ("crown", "string")), ("backlash", ("seabed", "string")))),
    Truth("preload", "Preload between platform and crown", one("F"), 2e3,
          also=(("constant force", ("crown",)), ("constant force", ("seabed", "crown")))),
    Truth("presliding", f"DahlFriction {BETWEEN}", one("F_c"), 3e3, shapes={"x_s": (1e-3, 8e-3)}),
    Truth("directional friction", f"DirectionalFriction {BETWEEN}", lambda a, drawn: {"F_p": 1.5 * a, "F_n": 0.7 * a}, 3e3),
    Truth("cogging", change=Change({"x": Part("Cogging")}, {"platform": ("+x.a",), "crown": ("+x.b",)}),
          owner="x", path=lambda a, drawn: {"F_0": a, "p": 0.35}, first=3e3),
    Truth("gas play", "SpringWithPlay in place of gas", one("gap"), 1e-2, 0.2,
          also=(("backlash", ("platform", "gas")), ("backlash", ("crown", "gas")))),
    Truth("gas compliance", "SeriesCompliance between platform and gas.a", lambda a, drawn: {"c": 1e6 / a}, 1.0, 30.0,
          also=(("series compliance", ("crown", "gas")),)),
    Truth("damper compliance", "SeriesCompliance between platform and damper.a", lambda a, drawn: {"c": 1e6 / a}, 1.0, 30.0,
          also=(("series compliance", ("crown", "damper")),)),
    Truth("two-rate spring", "BilinearSpring in place of gas", lambda a, drawn: {"k": a, "s_0": -0.1}, 0.1, 0.9),
    *signals({"SensorOffset": PULL, "Delay": PULL, "FirstOrderLag": HEAVE, "SensorGain": REACH, "Saturation": RISE,
              "DeadBand": PULL, "RateLimit": HEAVE}, RIG),
    *signals({"SensorOffset": RISE, "Delay": HEAVE, "FirstOrderLag": REACH, "SensorGain": PULL, "Saturation": REACH,
              "DeadBand": RISE, "RateLimit": PULL}, RIG)]

# -- the cylinder rig --------------------------------------------------------------------------------------------------
SPOOL, STROKE, P_A = "before valve.u", "in the channel load.x", "in the channel chamber_a.p"
CYL = {SPOOL: 0.2, STROKE: 0.3, P_A: 2e6}
FRAME = "between frame and load"
CYLINDER = [
    Truth("piston leak", "Cylinder in cylinder (leakage)", one("leakage"), 1e-11,
          also=(("leakage", ("chamber_a", "chamber_b")),)),
    Truth("overlap", "ProportionalValve43 in valve (overlap)", one("overlap"), 0.005, 0.2),
    Truth("rod friction", f"CoulombFriction {FRAME}", one("F_c"), 2e3, law="StiffBristle",
          also=(("dry friction", ("wall", "load")),)),
    Truth("entrained air", "Cylinder in cylinder (air)", one("air"), 0.005, 0.05),
    Truth("leak to return", "LaminarLeakage between return and chamber_a", one("C"), 1e-11),
    Truth("supply droop", "DroopingSource in place of pump", one("R"), 1e8, also=(("line resistance", ("supply", "pump")),)),
    Truth("hose", "Hose on chamber_a", one("C"), 1e-12),
    Truth("line", "LineResistance between chamber_a and valve.A", lambda a, drawn: {"R": a, "K": 0.0}, 1e8),
    Truth("seal friction", f"SealFriction {FRAME}, pressed by chamber_a", one("k_p"), 1e-4),
    Truth("drag", f"Drag {FRAME}", one("d_2"), 1e4, law="RoundedDrag"),
    Truth("added mass", "Mass on load", one("m"), 3e3),
    Truth("position leak", change=Change({"x": Part("PositionLeak")}, {"chamber_a": ("+x.a",), "chamber_b": ("+x.b",),
                                                                       "load": ("+x.m",)}),
          owner="x", path=lambda a, drawn: {"C": a, "s_0": 0.3}, first=1e-11,
          also=(("leakage", ("chamber_a", "chamber_b")), ("internal leakage", ("cylinder",)))),
    Truth("turbulent leak", "TurbulentLeakage between chamber_a and chamber_b", one("A"), 1e-7,
          also=(("internal leakage", ("cylinder",)),)),
    Truth("spool delay", "Delay before valve.u", first=0.02, most=1.0, filter=delay, shapes={"sign": (0.0, 1.0)}),
    Truth("rod play", "Backlash between load and cylinder.b", lambda a, drawn: {"gap": a, "c": 1e8}, 1e-3, 0.05),
    Truth("preload", f"Preload {FRAME}", one("F"), 2e3, also=(("constant force", ("load",)),)),
    Truth("stop", f"EndStop {FRAME}", lambda a, drawn: {"c": a, "x_min": -0.15, "x_max": 0.15}, 1e5, law="HertzStop",
          also=(("end stop", ("wall", "load")),)),
    Truth("inertance", "LineInertance between chamber_a and valve.A", one("I"), 1e6),
    Truth("valve leak", "ProportionalValve43 in valve (leakage)", one("leakage"), 1e-11),
    Truth("Stribeck", f"StribeckFriction {FRAME}", one("F_c"), 2e3, law="StiffBristle",
          shapes={"r": (1.3, 2.0), "v_s": (0.02, 0.1), "x_s": (2e-5, 5e-4)}),
    Truth("hardening", f"CubicSpring {FRAME}", lambda a, drawn: {"c_3": a, "l0": 0.0}, 1e5),
    *signals({"SensorOffset": SPOOL, "SensorGain": P_A, "FirstOrderLag": STROKE, "Saturation": SPOOL, "DeadBand": SPOOL,
              "RateLimit": SPOOL, "Delay": STROKE}, CYL)]

TRUTHS = {"receiver": RECEIVER, "passive": PASSIVE, "cylinder": CYLINDER}
PAIRS = {"receiver": [("choked inlet", f"SensorOffset {PRESSURE}"), ("leak in", f"Delay {OPENING}")],
         "passive": [("Coulomb", "cubic spring"), ("drag", f"SensorOffset {PULL}")],
         "cylinder": [("piston leak", "rod friction"), ("overlap", "line")]}
