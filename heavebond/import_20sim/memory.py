"""Functions of SIDOPS with memory: integrals, discrete functions, rounding followed by events, and events.

`sample`, `hold`, `previous`, `dint` and `ddif` act every sample time. Their memory is constant between the samples and
changes at the same instant: `hold` takes the value of the discrete expressions at the sample, in which `previous` and
`dint` have the value before it. Between samples the discrete expressions follow the sampled signals.
"""

from __future__ import annotations

import re
from collections.abc import Collection

from heavebond.import_20sim import formula_text as f
from heavebond.import_20sim.choices import at_event, names, renamed, simplified, triggers
from heavebond.import_20sim.component import Component, Item
from heavebond.import_20sim.evaluate import fold
from heavebond.import_20sim.expressions_parser import Unreadable
from heavebond.import_20sim.matrices import total
from heavebond.import_20sim.names import identifier
from heavebond.import_20sim.sidops_tree import Expr

SAMPLE_TIME = "sampletime"
SAMPLE = "sample"  # name of the event at every sample
SAMPLED = "sampled"  # suffix of the values at the last sample
DELAYED = "state of the delay"
PAIRS = 3  # number of pairs of states in a delay, as in the library's PadeDelay


class Memory:
    """The memory of one component; `target` is the quantity that is being assigned, from which the names of additions are
    derived.
    """

    def __init__(self, component: Component):
        self.component, self.target = component, ""
        self.begun: dict[str, Expr] = {}  # initial values of differentiated quantities

    def _name(self, rate: Expr, ending: str) -> str:
        label = rate.name if rate.op == "name" and "." not in rate.name else self.target or ending
        return identifier(f"{label}_{ending}" if label != ending else ending)

    # -- integrals ---------------------------------------------------------------------------------------------------
    def state(self, rate: Expr, first: Expr | None, line: int, ending: str = "int") -> Expr:
        """A new state with this rate, for an integral inside an expression."""
        name = self.component.fresh(self._name(rate, ending))
        self.component.items[name] = Item(name, "variable", "", "integral")
        self.component.equations.append((f.call("der", f.name(name)), at_event(rate, None), ""))
        self.component.initial[name] = first or f.number(0)
        return f.name(name)

    def begins(self, state: Expr, first: Expr) -> None:
        """Enter the initial value of x from `ddt (x, first)`, if no other equation assigns x."""
        if state.op == "name":
            self.begun[state.name] = first

    def resettable(self, args: list[Expr], line: int) -> Expr:
        """`resint(x, new, reset, first)`: the integral of x, set to `new` when `reset` becomes true, constant while it
        is.
        """
        if len(args) not in (3, 4):
            raise Unreadable(line, "`resint` needs a rate, a new value, a reset and a first value")
        rate, new, reset = args[:3]
        reset, new = f.truth(reset), at_event(new, None)
        between = at_event(reset, None)
        integral = self.state(simplified(Expr("if", (between, f.number(0), rate))), args[3] if len(args) > 3 else None, line,
                              "resint")
        for trigger in triggers(reset):
            for ending, when in self.instants(trigger):
                then = simplified(Expr("if", (at_event(reset, trigger), new, integral)))
                self.component.on(f"{integral.name}_reset_{ending}", when, {integral.name: then})
        if between.op != "number":
            self.component.on(f"{integral.name}_reset", {"condition": f.text(between)}, {integral.name: new})
            self.component.on("at_start", {"at": "0"}, {integral.name: Expr("if", (between, new, integral))})
        return integral

    def limited(self, args: list[Expr], line: int) -> Expr:
        """`limint(x, low, high, first)`: the integral of x, which stays at a limit until x leads away from it."""
        if len(args) not in (3, 4):
            raise Unreadable(line, "`limint` needs a rate, two limits and a first value")
        rate, low, high = args[:3]
        at_limit = self.component.hold(self._name(rate, "at_limit"), "", "1 at the upper limit, -1 at the lower one",
                                       f.number(0))
        free = Expr("==", (f.name(at_limit), f.number(0)))
        integral = self.state(Expr("if", (free, rate, f.number(0))), args[3] if len(args) > 3 else None, line, "limint")
        for side, sign, limit in (("high", 1, high), ("low", -1, low)):
            at_this_limit = Expr("==", (f.name(at_limit), f.number(sign)))
            beyond, back = (">", "<") if sign > 0 else ("<", ">")
            # only if the rate leads outwards: it begins at the limit when it leaves it
            outwards = Expr("and", (Expr(beyond, (integral, limit)), Expr(beyond, (rate, f.number(0)))))
            self.component.on(f"{integral.name}_{side}", {"condition": f.text(Expr("and", (outwards, free)))},
                              {at_limit: f.number(sign), integral.name: limit})
            inwards = Expr("and", (Expr(back, (rate, f.number(0))), at_this_limit))
            self.component.on(f"{integral.name}_leaves_{side}", {"condition": f.text(inwards)}, {at_limit: f.number(0)})
        return integral

    def delayed(self, args: list[Expr], line: int) -> Expr:
        """`tdelay(x, T)`: x delayed by a Padé approximation in the form of PadeDelay: a chain of `PAIRS` pairs of states
        w and z that are 0 at the start, as if x had been 0 before."""
        if len(args) != 2:
            raise Unreadable(line, "`tdelay` needs a value and a delay")
        value, time = at_event(args[0], None), args[1]
        if fold(time, {}) == 0:
            return args[0]
        if fold(time, {}) is None and time.op != "name":
            name = self.component.fresh(self._name(value, "delay_time"))
            self.component.items[name] = Item(name, "variable", "", "delay of `tdelay`")
            self.component.equations.append((f.name(name), at_event(time, None), ""))
            time = f.name(name)
        w, z = ([self._state_from_zero(value, f"delay_{letter}{k + 1}") for k in range(PAIRS)] for letter in "wz")
        gaps = [Expr("-", (b, a)) for a, b in zip(w, z, strict=True)]
        per = Expr("/", (f.number(2), time))
        ahead = [total(gaps[k:]) for k in range(PAIRS)]
        for k in range(PAIRS):
            along = total([f.multiply(f.number(4.0 * j + 1), ahead[j]) for j in range(k + 1)])
            self.component.equations.append((f.call("der", w[k]), f.multiply(per, along), "delay" if k == 0 else ""))
            behind = Expr("-", (Expr("-", (value, w[k])), ahead[0]))
            self.component.equations.append((f.call("der", z[k]), f.add(f.call("der", w[k]), f.multiply(
                f.multiply(per, f.number(4.0 * k + 3)), behind)), ""))
        self.note(line, "`tdelay` is approximated by a filter of order 6 (Pade), good up to frequencies of about 1/T; "
                  "before the start its input counts as 0")
        result = Expr("-", (value, f.multiply(f.number(2), ahead[0])))
        if value.op == time.op == "name":
            self.component.delay = result, value.name, time.name
        return result

    def _state_from_zero(self, value: Expr, ending: str) -> Expr:
        """A new state that begins at 0."""
        name = self.component.fresh(self._name(value, ending))
        self.component.items[name] = Item(name, "variable", "", DELAYED)
        self.component.initial[name] = f.number(0)
        return f.name(name)

    # -- discrete functions ------------------------------------------------------------------------------------------
    def sample_time(self) -> Expr:
        """The sample time, a global parameter."""
        if SAMPLE_TIME not in self.component.items:
            self.component.items[SAMPLE_TIME] = Item(SAMPLE_TIME, "parameter", "s", "sample time of the discrete parts",
                                                     None)
            self.component.shared[SAMPLE_TIME] = SAMPLE_TIME
        return f.name(SAMPLE_TIME)

    def discrete(self, kind: str, args: list[Expr], final: Expr | None, line: int) -> Expr:
        """`sample`, `hold`, `previous`, `dint` or `ddif` of a value, with a first value; `final` is the variable of that
        value, if there is one: its stored value is the value after all statements of the sample."""
        if not args or len(args) > 2:
            raise Unreadable(line, f"`{kind}` needs a value and a first value")
        value, first = args[0], args[1] if len(args) > 1 else f.number(0)
        period = self.sample_time()
        if kind == "sample":
            self.component.samples = True
            return value
        if kind == "dint":
            doc = "sum of the samples before times the sample time"
            sampled_value = f.name(self.component.hold(self._name(value, "dint"), "", doc, first))
            self.sampled({sampled_value.name: f.add(sampled_value, f.multiply(period, value))})
            return sampled_value
        if kind == "hold":
            name = self.component.hold(self._name(value, "hold"), "", "held between the samples", first)
            self.sampled({name: value})
            return f.name(name)
        sampled_value = f.name(self.at_samples(value if final is None else final, first))
        return sampled_value if kind == "previous" else Expr("/", (Expr("-", (value, sampled_value)), period))

    def at_samples(self, value: Expr, first: Expr | None = None) -> str:
        """A held variable with the value at the last sample, and its first value."""
        event = self.component.events.get(SAMPLE)
        for name, old in event.then.items() if event is not None else ():
            if old == value and name.endswith(SAMPLED) and first in (None, self.component.first[name]):
                return name
        doc = f"{f.text(value)} at the last sample" if value.op == "name" else "value at the last sample"
        name = self.component.hold(self._name(value, SAMPLED), "", doc, f.number(0) if first is None else first)
        self.sampled({name: value})
        return name

    def keep_samples(self, quantities: Collection[str]) -> None:
        """Let continuous equations use the last sampled values of quantities that change at samples only."""
        component = self.component

        def with_samples(expr: Expr) -> Expr:
            for name in dict.fromkeys(n for n in names(expr) if n in quantities):
                expr = renamed(expr, name, f.name(self.at_samples(f.name(name))))
            return expr

        read: set[str] = set()  # by continuous equations
        for k, (left, right, comment) in enumerate(component.equations):
            if left.op != "name" or left.name not in quantities:
                component.equations[k] = with_samples(left), with_samples(right), comment
                read.update(n for side in component.equations[k][:2] for n in names(side))
        for label, event in component.events.items():
            conditions = re.findall(r"\w+", " ".join(event.when.values()))
            if label != SAMPLE and set(quantities) & set(conditions) and read & set(event.then):
                component.omitted.append((component.line,
                                          f"the event '{label}' follows a sampled quantity between the samples"))

    def sampled(self, then: dict[str, Expr]) -> None:
        """Set values at every sample, after all other events of the same instant, such as a step of an input: a clock
        counts the samples, and an unprocessed count is a sample."""
        if SAMPLE not in self.component.events:
            self.sample_time()
            ticks, counted = (self.component.hold(name, "", doc, f.number(0)) for name, doc in (
                ("ticks", "samples that are due"), ("samples", "samples that are taken")))
            self.component.on("tick", {"every": SAMPLE_TIME}, {ticks: f.add(f.name(ticks), f.number(1))})
            self.component.on(SAMPLE, {"condition": f"{ticks} > {counted}"}, {counted: f.name(ticks)})
        self.component.events[SAMPLE].then.update({name: at_event(value, None) for name, value in then.items()})

    # -- events ------------------------------------------------------------------------------------------------------
    def event(self, kind: str, args: list[Expr], line: int) -> Expr:
        """An event as a condition that is true at its instant only."""
        if not args:
            raise Unreadable(line, f"`{kind}` needs an argument")
        return Expr("event", tuple(args), {"timeevent": "time", "eventup": "up", "eventdown": "down", "event": "both",
                                           "frequencyevent": "every"}[kind])

    def instants(self, event: Expr) -> list[tuple[str, dict[str, str]]]:
        """Suffixes of names and instants of an event: two for `event`, which occurs in both directions."""
        first = event.args[0]
        if event.name == "time" and first.op == "number" and first.value <= 0:
            return []  # at the start
        if event.name == "time":
            return [("in_time", {"condition": f.text(Expr(">=", (f.name("time"), first)))})]
        if event.name == "every":
            start = {"from": self._time(event.args[1], "first_time")} if len(event.args) > 1 else {}
            return [("every", {"every": self._time(first, "period"), **start})]
        up = ("up", {"condition": f.text(Expr(">", (first, f.number(0))))})
        down = ("down", {"condition": f.text(Expr("<", (first, f.number(0))))})
        return {"up": [up], "down": [down], "both": [up, down]}[event.name]

    def _time(self, value: Expr, name: str) -> str:
        """A parameter in s with this value, as a time of `every:` must be."""
        known = fold(value, {n: item.value for n, item in self.component.items.items() if item.value is not None})
        if known is None:
            raise Unreadable(0, "`frequencyevent` needs a period and a first time that are known")
        parameter_name = next((n for n, item in self.component.items.items() if item.doc.startswith("of `frequencyevent`")
                               and item.value == known), None) or self.component.fresh(name)
        self.component.items[parameter_name] = Item(parameter_name, "parameter", "s", "of `frequencyevent`", known)
        return parameter_name

    def noise(self, line: int) -> Expr:
        """Random noise is left out."""
        self.component.omitted.append((line, "random noise is left out: 0 is used"))
        return f.number(0)

    def require(self, index: Expr, size: int) -> bool:
        """Require that an index of parameters lies in a vector; False if it depends on more than parameters."""
        kinds = {item.kind if (item := self.component.items.get(n)) is not None else "" for n in names(index)}
        if kinds != {"parameter"}:
            return False
        limits = Expr(">", (index, f.number(0.5))), Expr("<", (index, f.number(size + 0.5)))
        self.component.requires += [limit for limit in limits if limit not in self.component.requires]
        return True

    def note(self, line: int, text: str) -> None:
        """List the interpretation of a construct."""
        if (line, text) not in self.component.omitted:
            self.component.omitted.append((line, text))

    # -- whole numbers -----------------------------------------------------------------------------------------------
    def floor(self, value: Expr) -> Expr:
        """The largest whole number not above a value, followed by events."""
        label = identifier(f"{self.target or 'value'}_floor")
        name = self.component.hold(label, "", "largest whole number not above the value", f.number(0))
        held = f.name(name)
        self.component.on("at_start", {"at": "0"}, {name: f.call("floor", value)})
        above, below = f.add(held, f.number(1)), Expr("-", (held, f.number(1)))
        self.component.on(f"{name}_up", {"condition": f.text(Expr(">=", (value, above)))},
                          {name: f.call("max", above, f.call("floor", value))})
        self.component.on(f"{name}_down", {"condition": f.text(Expr("<", (value, held)))},
                          {name: f.call("min", below, f.call("floor", value))})
        return held

    def truncated(self, ratio: Expr) -> Expr:
        """The whole part of a ratio, towards zero, followed by events."""
        name = self.component.hold(identifier(f"{self.target or 'value'}_steps"), "", "whole part of a ratio", f.number(0))
        whole = Expr("if", (Expr(">=", (ratio, f.number(0))), f.call("floor", ratio),
                            f.negative(f.call("floor", f.negative(ratio)))))
        held = f.name(name)
        up = Expr("or", (Expr("and", (Expr(">=", (held, f.number(0))), Expr(">", (ratio, f.add(held, f.number(1)))))),
                         Expr("and", (Expr("<", (held, f.number(0))), Expr(">", (ratio, held))))))
        below = Expr("-", (held, f.number(1)))
        down = Expr("or", (Expr("and", (Expr("<=", (held, f.number(0))), Expr("<", (ratio, below)))),
                           Expr("and", (Expr(">", (held, f.number(0))), Expr("<", (ratio, held))))))
        self.component.on("at_start", {"at": "0"}, {name: whole})
        # by one, or by several if the ratio jumps
        self.component.on(f"{name}_up", {"condition": f.text(up)}, {name: f.call("max", f.add(held, f.number(1)), whole)})
        self.component.on(f"{name}_down", {"condition": f.text(down)}, {name: f.call("min", below, whole)})
        return held
