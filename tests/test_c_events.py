"""C programs with events and physical limits: compiled, run from point to point, and compared with `simulate`."""

from __future__ import annotations

import ctypes
from pathlib import Path

import fmpy
import numpy as np
import pytest
from click.testing import CliRunner
from collected import partly
from test_co_simulation_fmu import get, opened
from test_export import Compiled, compiled
from test_fmu_events import BALL, SWITCHED, circuit
from test_physical_limits import DRAINED, PULLED

import heavebond as hb
from heavebond.cli import main
from heavebond.exchange.c_code import export_c
from heavebond.exchange.fmu_export import export_fmu
from heavebond.language.library import bundled

pytestmark = compiled


class Program:
    """A run of a diagram in compiled C."""

    def __init__(self, model: hb.Model, folder: Path, inputs: tuple[str, ...] = ()):
        path = folder / f"{model.name}.c"
        self.code = Compiled(export_c(model, path, inputs), path)
        self.made, self.library, self.prefix = self.code.made, self.code.library, self.code.prefix
        self._size = getattr(self.library, f"{self.prefix}_size")
        self._size.restype = ctypes.c_size_t
        self.run, self.message = ctypes.create_string_buffer(self._size()), ctypes.create_string_buffer(400)
        self.begin()

    def begin(self, t: float = 0.0, **changed: float) -> None:
        p = np.array([changed.get(q.name.replace(".", "_"), q.start) for q in self.made.parameters])
        getattr(self.library, f"{self.prefix}_begin")(self.run, ctypes.c_double(t), _pointer(p))

    def advance(self, end: float, *u: float) -> np.ndarray | str:
        """The outputs at the time `end`, or the message of a run that has to end."""
        y = np.zeros(max(1, len(self.made.outputs)))
        wrong = getattr(self.library, f"{self.prefix}_advance")(
            self.run, ctypes.c_double(end), _pointer(np.array(u)) if u else None, None, _pointer(y), self.message,
            ctypes.c_size_t(len(self.message)))
        return self.message.value.decode() if wrong else y[: len(self.made.outputs)]


def _pointer(values: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(values.ctypes.data)


def agree(model: hb.Model, folder: Path) -> None:
    program, run = Program(model, folder), hb.simulate(model, rtol=1e-11)
    assert run.events
    found = np.array([program.advance(t) for t in run.time])
    for k, output in enumerate(program.made.outputs):
        exact = run.display[output.name]
        # two integrators with errors of 1e-9 and 1e-11 a step, over thousands of steps
        assert np.abs(found[:, k] - exact).max() < 1e-6 * max(float(np.ptp(exact)), 1e-9), output.name


@pytest.mark.parametrize("name", [
    "BALL", *(pytest.param(name, marks=pytest.mark.long) for name in ("SWITCHED", "tank_level")),
    *(pytest.param(name, marks=pytest.mark.slow) for name in (
        "positioning_servo", "pneumatic_hammer", "vibrating_conveyor", "train_buffers"))])
def test_a_c_program_runs_through_events_as_simulate(name: str, tmp_path: Path) -> None:
    """A stop with impacts; a relay, samples and a comparator; a pump that a level switches."""
    texts = {"BALL": BALL, "SWITCHED": SWITCHED.replace("u: 0}", "u: =4*sin(5 rad/s*time)}")}
    agree(hb.loads(texts[name]) if name in texts else hb.load(circuit(f"circuits/{name}.yaml")), tmp_path)


@pytest.mark.slow
def test_every_example_with_events_as_a_c_program(tmp_path: Path) -> None:
    for path in sorted((bundled("models") / "examples").glob("*.yaml")):
        flat = hb.assemble(model := hb.load(path)).flat
        if not flat.inputs and not all(event.by_clock for event in flat.events):
            agree(model, tmp_path)


def test_a_condition_that_ends_at_an_output_point_does_not_begin_there(tmp_path: Path) -> None:
    """The trigger falls at 0.35 s, where it is 4e-16 above its threshold for the rounding of the cosine."""
    agree(hb.load(circuit("examples/triggered_sample_hold.yaml")), tmp_path)


def test_inputs_parameters_and_snapshots_of_a_c_program(tmp_path: Path) -> None:
    program = Program(hb.loads(SWITCHED.replace("u: 0}", "u: -2}")), tmp_path, ("relay.u",))
    program.advance(0.4, 2.0)  # on from 0 s
    held = program.advance(0.45, 2.0)
    assert not isinstance(held, str)
    level, taken, alarm = held
    assert level == pytest.approx(5 * (1 - np.exp(-0.45 / 0.2)), abs=1e-8)
    assert taken == pytest.approx(5 * (1 - np.exp(-0.4 / 0.2)), abs=1e-8)  # sampled every 0.1 s
    assert alarm == 1  # above 4 from 0.322 s on
    snapshot = program.run.raw
    first = program.advance(1.0, -2.0)
    program.run.raw = snapshot
    assert np.array_equal(program.advance(1.0, -2.0), first)  # a copy of its memory is the whole run
    assert first[0] == pytest.approx(level * np.exp(-0.55 / 0.2), abs=1e-8)
    program.begin(lag_T_1=0.1)
    assert program.advance(0.1, 2.0)[0] == pytest.approx(5 * (1 - np.exp(-1)), abs=1e-8)


def test_events_without_end_and_wrong_times_end_a_c_program_with_a_message(tmp_path: Path) -> None:
    program = Program(hb.loads(SWITCHED), tmp_path)
    program.advance(0.5)
    assert "before its begin" in str(program.advance(0.4))
    program.begin(taken_T_s=-1.0)
    assert "taken.T_s is -1 s; it must be at least" in str(program.advance(0.1))


def test_a_c_program_ends_at_a_physical_limit(tmp_path: Path) -> None:
    """With a pump that a relay switches; empty after 100 s at 1 L/s out of 0.1 m2 and 1 m."""
    text = DRAINED.replace("components:", "components:\n  alarm: {is: Comparator, level: 0.5, u: =tank.h/(1 m)}")
    program = Program(hb.loads(text), tmp_path)
    assert program.advance(99.0)[0] == pytest.approx(0.01, abs=1e-8)
    message = str(program.advance(102.0))
    assert message.startswith("tank.h falls below 0 m at ") and "Relay" in message
    assert 100 < float(message.split(" at ")[1].split(" s")[0]) <= 102


def test_a_program_with_an_integrator_of_its_own_tests_physical_limits(tmp_path: Path) -> None:
    model = hb.loads(PULLED)
    code = Compiled(export_c(model, tmp_path / "pulled.c"), tmp_path / "pulled.c")
    x, z, p = (code.start(letter, n) for letter, n in (("x", len(code.made.states)), ("z", len(code.made.algebraic)),
                                                       ("p", len(code.made.parameters))))
    message, found = ctypes.create_string_buffer(300), []
    rod = [q.name for q in code.made.states].index("rod.x")
    for t in (1.99, 2.01):  # the volume 0.2 L - 10 cm2 * 0.1 m/s t is gone after 2 s
        x[rod] = -0.1 * t
        found.append(code.library.pulled_check(ctypes.c_double(t), *map(_pointer, (x, z, p, np.zeros(1))), message,
                                               ctypes.c_size_t(300)))
    assert found[0] == 0 and found[1] > 0
    assert message.value.decode().startswith("ram.V_A falls below 0 m**3 at 2.01 s: ") and b"EndStop" in message.value


@pytest.mark.parametrize("version", partly([2, 3], 2))
def test_an_fmu_ends_with_an_error_at_a_physical_limit(version: int, tmp_path: Path, capfd: pytest.CaptureFixture[str]
                                                       ) -> None:
    """In co-simulation, and in model exchange at a completed step of the integrator."""
    export_fmu(hb.loads(DRAINED), tmp_path / "m.fmu", version=version)
    with opened(tmp_path / "m.fmu", version) as (made, numbers):
        made.doStep(0.0, 99.0)
        assert get(made, numbers["level"]) == pytest.approx(0.01, abs=1e-8)
        with pytest.raises(fmpy.fmi1.FMICallException) as caught:
            made.doStep(99.0, 3.0)
        assert caught.value.status == 3  # fmi2Error, fmi3Error
    if version == 3:
        assert "tank.h falls below 0 m at " in capfd.readouterr().out
    with pytest.raises(fmpy.fmi1.FMICallException, match="ompletedIntegratorStep"):
        fmpy.simulate_fmu(str(tmp_path / "m.fmu"), fmi_type="ModelExchange", stop_time=150.0, output_interval=1.0)


def test_the_command_writes_a_c_program_with_events(tmp_path: Path) -> None:
    (tmp_path / "switched.yaml").write_text(SWITCHED)
    words = ["export", str(tmp_path / "switched.yaml"), "-o", str(tmp_path / "s.c")]
    assert CliRunner().invoke(main, words).exit_code == 0
    head = (tmp_path / "s.c").read_text().partition("*/")[0]
    assert "int s_advance(" in head and "snapshot" in head
