"""Exchange of signals with the FMUs of a diagram. This is the only module that executes code from a file, with the user's
permission.

An FMU advances from t_{k-1} to t_k with the inputs of t_{k-1}. At t_k its outputs are read, and it receives its inputs at
t_k, with their values before the exchange. At the start it is initialised, and its first outputs are read. An FMU for
co-simulation has a solver; `ModelExchange` integrates the others.
"""

from __future__ import annotations

import ctypes
import tempfile
from collections import deque
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Any
from weakref import WeakValueDictionary

import casadi as ca
import numpy as np

from heavebond.core.errors import Problem, SimulationError, UsageError, listing
from heavebond.core.native_permission import fmu_allowed
from heavebond.core.presentation import count
from heavebond.equations.flatten import Flat
from heavebond.language.definition import Foreign, ForeignVariable
from heavebond.language.symbols import stack
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.model_exchange import Clocks, EventSteps, ModelExchange
from heavebond.numerics.start_equations import Point

REALS = ("Real", "Float64", "Float32")
LOG_LINES = 5  # lines of the log of an FMU in a message
DISCARD, TERMINATED = 2, 3  # fmi2Discard, and the kind of status fmi2Terminated


def foreign_parts(flat: Flat) -> dict[str, Foreign]:
    """The FMUs of a diagram by the path of their component."""
    return {path: leaf.component.foreign for path, leaf in flat.expanded.leaves.items() if leaf.component.foreign}


def check_allowed(flat: Flat, allowed: bool, sensitivities: Sequence[str]) -> None:
    """Raise UsageError for a diagram with FMUs if their code must not be executed (neither `allowed` nor a context of
    `fmu_code`), or if derivatives through them are needed."""
    parts = foreign_parts(flat)
    if not parts:
        return
    files = listing(dict.fromkeys(f"{foreign.path.name}" for foreign in parts.values()))
    if not (allowed or fmu_allowed()):
        raise UsageError([Problem(
            "fmu-not-allowed", f"this diagram runs the program in {files}, which can do whatever a program can", None,
            "If you trust it: `heavebond run MODEL --allow-fmu`, `heavebond studio --allow-fmu`, or `simulate(model, "
            "allow_fmu=True)`. Other commands do not run FMUs.")])
    if sensitivities:
        raise UsageError([Problem("fmu-sensitivity", f"there are no derivatives through {files}: an FMU does not "
                                  "provide the derivatives of its outputs", None, "Run it without sensitivities.")])


@dataclass(eq=False)
class _Partner:
    """One FMU: which event exchanges its signals, which rows of the resets are its outputs, and its running instance."""

    path: str
    foreign: Foreign
    rows: Sequence[int]
    inputs_and_parameters: ca.Function
    instance: Any = None
    version: str = ""
    reached: float = np.nan  # until it is initialised
    callbacks: Any = None  # kept for as long as its program may call them
    messages: deque[str] = field(default_factory=deque)  # the last lines of its log
    stepper: EventSteps | None = None  # for model exchange, and for co-simulation with clocks
    clocked: dict[int, float] = field(default_factory=dict)  # outputs at the last ticks of clocks, by their numbers
    times: list[float] = field(default_factory=list)  # of the communications
    outputs: list[float] = field(default_factory=list)  # at the last of them
    inputs: Array | None = None  # from the last of them
    ended: bool = False  # it asked for the end of the run


class Partners:
    """All FMUs of a diagram by the number of the event in which each exchanges its signals."""

    def __init__(self, assembly: Assembly, rows: Sequence[Sequence[int]]):
        self.parts: dict[int, _Partner] = {}
        parts = foreign_parts(assembly.flat)
        for event, (flat_event, reset_rows) in enumerate(zip(assembly.flat.events, rows, strict=True)):
            path = flat_event.name.rpartition(".")[0]
            if path in parts:
                foreign = parts[path]
                self.parts[event] = _Partner(path, foreign, reset_rows, _inputs_and_parameters(assembly, path, foreign))

    @property
    def ended(self) -> bool:
        """Whether an FMU has asked for the end of the run."""
        return any(part.ended for part in self.parts.values())

    @property
    def reports(self) -> list[str]:
        """A sentence on the communications with each FMU in the last run."""
        sentences = []
        for part in self.parts.values():
            steps = np.diff(part.times)
            every = f" every {steps.mean():.6g} s" if len(steps) else ""
            if len(part.times) == 1:
                every = ": its outputs kept their start values, because its step is not shorter than the run"
            end = f"; it ended the run at t = {part.times[-1]:.6g} s" if part.ended else ""
            end += f" ({part.messages[-1]})" if part.ended and part.messages else ""
            use = "" if part.foreign.has_solver else ", model exchange"
            events = "" if part.stepper is None else f"; {count(part.stepper.events, 'event')} between them"
            sentences.append(f"{part.path} ({part.foreign.path.name}, FMI {part.version}{use}): "
                             f"{count(len(part.times), 'communication point')}{every}{events}{end}")
        return sentences

    @contextmanager
    def running(self) -> Iterator[None]:
        """Context of a run: open and initialise each FMU, and terminate all of them at the end."""
        if not self.parts:
            yield
            return
        with tempfile.TemporaryDirectory(prefix="heavebond_fmu_") as folder:
            try:
                for number, part in enumerate(self.parts.values()):
                    _open(part, f"{folder}/{number}")
                yield
            finally:
                for part in self.parts.values():
                    if part.instance is None:
                        continue
                    try:
                        if not np.isnan(part.reached):
                            part.instance.terminate()
                    except Exception:  # it is thrown away; an FMU that failed before may refuse this too
                        part.messages.append("it did not terminate")
                    part.instance.freeInstance()
                    part.instance = None

    def outputs(self, point: Point, fired: Sequence[int]) -> dict[int, float]:
        """The outputs of the FMUs whose events happen at a point, by the rows of the resets; each FMU has reached the
        point."""
        outputs: dict[int, float] = {}
        for part in (self.parts[event] for event in fired if event in self.parts):
            _check_running(part)
            with _failing(part, point.t):
                # advance to the communication point with the inputs of the previous one; an FMU that asks for the end of
                # the run keeps its last outputs if it does not give others
                if np.isnan(part.reached):
                    inputs, parameters = (np.array(v).ravel() for v in part.inputs_and_parameters(*point.values()))
                    # initialise with parameters and first inputs
                    instance = part.instance
                    start = {"startTime": point.t}
                    if part.version.startswith("2"):
                        instance.setupExperiment(**start)
                        start = {}
                    _set(instance, part.foreign.parameters, parameters)
                    instance.enterInitializationMode(**start)
                    _set(instance, part.foreign.inputs, inputs)
                    instance.exitInitializationMode()
                    if part.stepper is not None:
                        part.stepper.begin(point.t)
                        part.ended = part.stepper.ended
                else:
                    _advance(part, point.t)
                part.reached = point.t
                part.times.append(point.t)
                try:
                    values = _get(part.instance, part.foreign.outputs)
                    part.outputs = [part.clocked.get(k, value) for k, value in enumerate(values)]
                except Exception:
                    if not part.ended:
                        raise
                outputs.update(zip(part.rows, part.outputs, strict=True))
        return outputs

    def give_inputs(self, point: Point, fired: Sequence[int]) -> None:
        """Set the inputs, for their next steps, of the FMUs whose events have happened, at the point after these."""
        for part in (self.parts[event] for event in fired if event in self.parts):
            _check_running(part)
            with _failing(part, point.t):
                inputs = np.array(part.inputs_and_parameters(*point.values())[0]).ravel()

                def set_inputs(part: _Partner = part, inputs: Array = inputs) -> None:
                    _set(part.instance, part.foreign.inputs, inputs)

                if part.stepper is None:
                    set_inputs()
                elif len(inputs) and (part.inputs is None or not np.array_equal(inputs, part.inputs)):
                    before = np.zeros(len(inputs)) if part.inputs is None else part.inputs
                    part.stepper.clocks.trigger([v.reference for v, old, new in zip(part.foreign.inputs, before, inputs,
                                                 strict=True) if v.type == "Clock" and old <= 0.5 < new])
                    part.stepper.change_inputs(set_inputs)
                    part.ended = part.stepper.ended
                part.inputs = inputs


def _inputs_and_parameters(assembly: Assembly, path: str, foreign: Foreign) -> ca.Function:
    """The inputs and the parameters of an FMU in SI."""
    flat = assembly.flat
    inputs = stack([assembly.express(flat.levels[0][flat.names[f"{path}.{v.name}"]]) for v in foreign.inputs])
    parameters = stack([assembly.express(flat.constants[f"{path}.{v.name}"]) for v in foreign.parameters])
    return ca.Function("given", list(assembly.arguments), [inputs, parameters])


# -- one FMU ---------------------------------------------------------------------------------------------------------
def _open(part: _Partner, folder: str) -> None:
    """Unpack an FMU and load its program."""
    import fmpy

    name = part.foreign.path.name
    try:
        fmpy.extract(str(part.foreign.path), folder)
        description = fmpy.read_model_description(folder, validate=False)
        part.version, part.messages, part.reached = description.fmiVersion, deque(maxlen=LOG_LINES), np.nan
        part.times, part.outputs, part.inputs, part.ended = [], [], None, False
        part.instance = _instance(part, folder, description)
        clocks = Clocks(part.instance, part.foreign.clocks, part.foreign.output_clocks, partial(_read_clocked, part))
        part.clocked, part.stepper = {}, None
        if not part.foreign.has_solver:
            part.stepper = ModelExchange(part.instance, clocks, part.version, description.numberOfContinuousStates or 0,
                                         description.numberOfEventIndicators or 0)
        elif part.foreign.has_events:
            part.stepper = EventSteps(part.instance, clocks)
    except Exception as error:  # wrong platform, missing libraries, refused instance: all are the FMU's own
        first_line = (str(error).splitlines() or [""])[0]
        raise SimulationError([Problem("fmu-not-loaded", f"{name} cannot be loaded on this machine", None,
                                       "It needs a binary for this platform among its `binaries/`.",
                                       (*part.messages, first_line.replace(folder, name)))]) from error


def _instance(part: _Partner, folder: str, description: Any) -> Any:
    from fmpy import fmi2, fmi3

    arguments = {"guid": description.guid, "unzipDirectory": folder, "modelIdentifier": part.foreign.identifier,
                 "instanceName": part.path}
    if part.version.startswith("2"):
        instance = (fmi2.FMU2Slave if part.foreign.has_solver else fmi2.FMU2Model)(**arguments)
        part.callbacks = fmi2.fmi2CallbackFunctions()
        ctypes.pointer(part.callbacks)[0] = _callbacks()
        part.callbacks.componentEnvironment = id(part)
        _PARTNERS[id(part)] = part
        instance.instantiate(callbacks=part.callbacks)
        return instance

    def heard3(_: object, status: int, __: object, message: bytes) -> None:
        part.messages.append(message.decode(errors="replace"))

    if part.foreign.has_solver:
        slave = fmi3.FMU3Slave(**arguments)
        slave.instantiate(logMessage=heard3, eventModeUsed=part.foreign.has_events)
        return slave
    instance = fmi3.FMU3Model(**arguments)
    instance.instantiate(logMessage=heard3)
    return instance


def _read_clocked(part: _Partner, ticking: Collection[int]) -> None:
    """Store the outputs that an FMU computes when these of its clocks tick."""
    values = _get(part.instance, part.foreign.outputs)
    part.clocked |= {k: values[k] for k, variable in enumerate(part.foreign.outputs) if {*variable.clocks} & {*ticking}}


_PARTNERS: WeakValueDictionary[int, _Partner] = WeakValueDictionary()  # by their environment in callbacks


@cache
def _callbacks() -> Any:
    """The callbacks of FMI 2.0, which exist until the process ends. A library of FMPy inserts the arguments into the
    messages; it calls one logger for all FMUs of the process, also for FMUs that another module opens by FMPy."""
    from fmpy import fmi2

    def heard(environment: int | None, name: bytes, status: int, category: bytes, message: bytes) -> None:
        path = name.decode(errors="replace")  # for an FMU that does not pass its environment on
        named = [part for part in _PARTNERS.values() if part.instance is not None and part.path == path]
        if part := _PARTNERS.get(environment or 0) or (named[-1] if named else None):
            part.messages.append(message.decode(errors="replace"))
        else:
            fmi2.printLogMessage(environment, name, status, category, message)

    callbacks = fmi2.fmi2CallbackFunctions()
    callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(heard)
    callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(fmi2.calloc)
    callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(fmi2.free)
    with suppress(Exception):  # the library exists for some platforms only
        from fmpy.logging import addLoggerProxy

        addLoggerProxy(ctypes.byref(callbacks))
    return callbacks


def _check_running(part: _Partner) -> None:
    """UsageError if the events of a diagram are evaluated outside a run, as by a linear analysis."""
    if part.instance is None:
        raise UsageError([Problem("fmu-not-run", f"{part.path} is the program in {part.foreign.path.name}, which runs in "
                                  "simulations only", None, "Use `heavebond run MODEL --allow-fmu`. For modes and linear "
                                  "analysis put a component with the same law in its place.")])


@contextmanager
def _failing(part: _Partner, time: float) -> Iterator[None]:
    """Context: raise SimulationError with the messages of an FMU if it fails."""
    try:
        yield
    except Exception as error:
        message = (str(error).splitlines() or [""])[0]
        raise SimulationError([Problem("fmu-failed", f"{part.path} ({part.foreign.path.name}) failed at t = {time:.6g} s",
                                       None, "", (*part.messages, message))]) from error


def _advance(part: _Partner, time: float) -> None:
    from fmpy.fmi1 import FMICallException

    if part.stepper is not None:
        part.stepper.advance(time)
        part.ended = part.stepper.ended
        return
    step = {"currentCommunicationPoint": part.reached, "communicationStepSize": time - part.reached}
    if not part.version.startswith("2"):
        part.ended = bool(part.instance.doStep(**step)[1])
        return
    try:
        part.instance.doStep(**step)
    except FMICallException as error:
        # a discarded step is the way of FMI 2.0 to ask for the end
        if error.status != DISCARD or not part.instance.getBooleanStatus(TERMINATED):
            raise
        part.ended = True


def _set(instance: Any, variables: Sequence[ForeignVariable], values: Array) -> None:
    """Set variables, the elements of an array in one call."""
    for first in (k for k, variable in enumerate(variables) if variable.element == 0):
        variable, raw = variables[first], []
        if variable.type == "Clock":  # it ticks in an event
            continue
        for value in values[first:first + variable.size]:
            number = float((value - variable.offset) / variable.scale)
            raw.append(number if variable.type in REALS else number > 0.5 if variable.type == "Boolean" else round(number))
        getattr(instance, f"set{variable.type}")([variable.reference], raw)


def _get(instance: Any, variables: Sequence[ForeignVariable]) -> list[float]:
    """The values of variables, with the elements of an array by one call."""
    values = []
    for variable in (v for v in variables if v.element == 0):
        number = {} if variable.size == 1 else {"nValues": variable.size}
        raw = getattr(instance, f"get{variable.type}")([variable.reference], **number)
        values += [float(value) * variable.scale + variable.offset for value in raw]
    return values
