"""Hard models of structure, lost rank, start and algebraic loops: each runs to a known end, or says what is wrong.

`tests/hard/NAME.yaml` stands for a pain that users of acausal tools report; its first comment says which. What the program
says of those that cannot run is `tests/hard/NAME.txt`, compared letter by letter (`--update-golden` rewrites them, to be
read in the diff); the others end at values from a formula beside them.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import fsolve

import heavebond as hb
from heavebond.core.errors import HeavebondError

HARD = Path(__file__).parent / "hard"
LPM = 1e-3 / 60

# those that must be refused, before a run or during it
REFUSED = (
    # structure
    "two_sources_on_one_node", "sources_joined_through_a_sensor", "circuit_without_reference",
    "flow_sources_into_a_rigid_junction", "loop_of_rigid_transformers", "springs_that_float",
    "fixed_at_both_ends_of_a_rigid_chain", "torque_on_a_free_shaft", "signal_loop_without_memory",
    "two_circuits_without_reference", "heat_that_goes_nowhere",
    # lost rank
    "mass_of_zero_under_a_force", "resistance_of_zero_between_sources", "bulk_modulus_of_zero",
    "valves_shut_at_the_start", "valve_shuts_during_the_run", "valves_shut_for_good_during_the_run",
    "valve_shut_for_good_before_a_dead_end",
    "slide_that_drives_a_crank_at_dead_centre",
    # start
    "rigid_inertias_with_other_speeds", "steady_state_of_two_closed_chambers", "steady_and_a_place_as_well",
    "steady_load_that_nothing_holds", "solve_without_a_condition", "solve_beyond_the_bounds", "value_on_what_a_source_holds",
    "joined_volumes_at_other_pressures", "gas_that_begins_at_zero", "gauge_pressure_for_an_absolute_one",
    "coils_in_line_with_other_currents", "flow_forced_through_shut_valves", "controller_that_cannot_hold_its_load",
    "cylinder_that_begins_at_zero_volume", "check_valves_in_line_both_shut", "motions_at_both_ends_of_a_gear",
    "force_divided_by_the_time", "strut_too_long", "weight_on_a_contact_kilometres_below",
    # events, and what should be one
    "step_into_a_position_source", "coil_on_a_current_that_steps", "capacitor_on_a_voltage_that_steps", "sign_of_a_speed",
)


def _orifice(q_r: float, dp_r: float, dp: float, dp_t: float) -> float:
    """Flow of an Orifice in m**3/s."""
    return q_r / np.sqrt(dp_r) * dp / (dp**2 + dp_t**2) ** 0.25


def _bridge() -> tuple[float, float]:
    """Pressures left and right of the bridge, by SciPy from a guess near the solution, in units of the supply."""
    def unbalanced(p: np.ndarray) -> list[float]:
        left, right = p * 200e5

        def q(rated: float, dp: float) -> float:
            return _orifice(rated, 10e5, dp, 10.0)

        across = q(1, left - right)
        return [q(10, 200e5 - left) - q(20, left) - across, q(40, 200e5 - right) - q(10, right) + across]

    left, right = 200e5 * fsolve(unbalanced, [0.23, 0.93], xtol=1e-13)
    return float(left), float(right)


def _dp_at_rated_flow(dp_r: float, dp_t: float) -> float:
    """The drop of an Orifice at its rated flow: dp**4 = dp_r**2 (dp**2 + dp_t**2)."""
    return float(np.sqrt((dp_r**2 + np.sqrt(dp_r**4 + 4 * dp_r**2 * dp_t**2)) / 2))


# outputs at the end of the run; the start is steady or the solution has a closed form
ENDS: dict[str, Callable[[], dict[str, float]]] = {
    "racks_of_other_radii_lock": lambda: {"load.v": 0.0, "shaft.w": 0.0},
    "rigid_inertias_with_the_same_speed": lambda: {"left.v": 1 + 3 / 3, "right.v": 2.0, "cell.y": -2.0},
    "gas_line_to_nowhere": lambda: {"end.p": 6e5, "end.T": 293.15},
    "signal_loop_that_has_a_solution": lambda: {"error": 1 / 4, "back": 3 / 4},
    "loop_of_plain_numbers": lambda: {"lag.y": np.exp(-0.4)},  # y' = (0.5 (0.2 + 1) - 1) y
    "load_hangs_still_at_a_pressure": lambda: {"load.x": 0.3, "A.p": 500 * 9.81 / 20e-4, "supply.p": 500 * 9.81 / 20e-4},
    "joined_volumes_both_steady": lambda: {"left.p": _dp_at_rated_flow(5e5, 1e4), "flow": 10 * LPM},
    "volume_of_zero": lambda: {"line.p": _dp_at_rated_flow(5e5, 1e4)},
    "capacitor_whose_series_resistance_is_zero": lambda: {"capacitor.v": 10.0},
    "volume_on_a_pressure_source": lambda: {"line.p": 1e7, "oil.a.q": 0.0},
    "inertance_behind_a_flow_source": lambda: {"line.p": 1e8 * 10 * LPM, "pipe.q_I": 10 * LPM},
    "bridge_of_sharp_orifices": lambda: dict(zip(("left.p", "right.p"), _bridge(), strict=True)),
    "load_above_an_open_contact": lambda: {"load.x": -100 * 9.81 / 1e6, "contact.N": 981.0},
    "weight_on_a_contact_far_below": lambda: {"load.x": (300 - 100 * 9.81) / 10e3, "contact.N": 300.0},
    "pump_on_a_relief_valve": lambda: {"line.p": 100e5 + 10 * LPM / 1e-10},
    "guess_that_a_formula_gives": lambda: {"load.x": 0.2 - 0.1 * np.cos(np.sqrt(1000 / 3))},
    "spring_jerked_at_its_end": lambda: {"body.x": 0.02 * (1 - np.cos(np.sqrt(1000 / 3) * 0.5))},
    "capacitors_that_divide_a_voltage": lambda: {"middle.v": 2 + 3 / 4 * 10},
    "cylinder_that_pushes_nothing": lambda: {"rod.v": 10 * LPM / 20e-4, "A.p": 0.0},
    "lever_of_no_arm": lambda: {"a.x": 0.1 * np.cos(10.0), "b.v": 0.0},
    "pump_that_stands_in_a_circuit": lambda: {"m.p": 0.0, "o2.q": 0.0},
    "motion_in_pieces": lambda: {"load.x": 0.25, "mass.a.f": 20.0},
    # a ripple of 20 A tanh(T/4 tau) that is reached with the time constant of the coil
    "inverter_of_10_khz": lambda: {"coil.i": -20 * np.tanh(0.1 / 4) * (1 - np.exp(-20))},
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_run_is_named(name: str, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    monkeypatch.chdir(HARD)
    with pytest.raises(HeavebondError) as caught:
        hb.simulate(hb.load(f"{name}.yaml"), solver="idas")  # alone, so that it has to say why
    golden = HARD / f"{name}.txt"
    # lines of library files move whenever something is written into these, and the columns of a table with them
    said = re.sub(r"(components/\w+/\w+\.yaml):\d+", r"\1", f"{caught.value}\n")
    said = re.sub(r"(?<=\S) {2,}", "  ", said)
    said = re.sub(r"IDA_\w+", "IDA_...", said)  # by which of its tests IDAS gives up is a matter of rounding
    if request.config.getoption("--update-golden"):
        golden.write_text(said, encoding="utf-8")
    assert said == golden.read_text(encoding="utf-8")
    assert all(problem.hint for problem in caught.value.problems)


@pytest.mark.parametrize("name", ENDS)
def test_what_can_run_ends_where_it_must(name: str) -> None:
    audit = hb.energy(hb.load(HARD / f"{name}.yaml"))
    assert audit.closes(), f"missing: {audit.imbalance:.1e}"
    nominal = {u.name: u.nominal for u in audit.result.assembly.flat.unknowns}
    names = audit.result.assembly.flat.names
    for signal, value in ENDS[name]().items():
        # 1e-6: some digits below the tolerance of the integration, 1e-9 a step; of the usual size where the value is zero
        unknown = audit.result.assembly.flat.unknowns[names[signal]].name
        assert audit.result.display[signal][-1] == pytest.approx(value, rel=1e-6, abs=1e-7 * nominal[unknown]), signal


def test_every_model_says_what_it_stands_for() -> None:
    files = sorted(HARD.glob("*.yaml"))
    assert {*REFUSED, *ENDS} <= {f.stem for f in files}
    assert len({*REFUSED, *ENDS}) >= 25
    assert all(f.read_text(encoding="utf-8").startswith("# ") for f in files)


# -- sensitivities through the start -------------------------------------------------------------------------------------
# (model, signal, parameter): the parameter moves the equilibrium, what is solved for, an algebraic loop or a guess
MOVED = (
    ("load_hangs_still_at_a_pressure", "A.p", "weight.m"), ("load_hangs_still_at_a_pressure", "supply.p", "press.A_A"),
    ("load_hangs_still_at_a_pressure", "supply.p", "initial.load.x"),
    ("pump_on_a_relief_valve", "line.p", "relief.C"), ("pump_on_a_relief_valve", "line.p", "relief.dp_0"),
    ("load_above_an_open_contact", "load.x", "contact.c"), ("load_above_an_open_contact", "load.x", "weight.m"),
    ("bridge_of_sharp_orifices", "left.p", "bridge.q_r"), ("bridge_of_sharp_orifices", "right.p", "left_1.q_r"),
    ("joined_volumes_both_steady", "right.p", "valve.q_r"), ("signal_loop_that_has_a_solution", "error", "gain.k"),
    ("guess_that_a_formula_gives", "load.x", "spring.l0"), ("rest_that_is_shaken", "load.x", "spring.c"),
    ("rest_that_is_shaken", "load.x", "weight.m"), ("rest_that_is_shaken", "spring.l0_found", "spring.c"),
)


@pytest.mark.parametrize(("name", "signal", "parameter"), MOVED)
def test_sensitivities_go_through_the_start(name: str, signal: str, parameter: str) -> None:
    assembly = hb.assemble(hb.load(HARD / f"{name}.yaml"))
    value = assembly.parameter_values[parameter]
    step = 1e-4 * abs(value)
    run = hb.simulate(assembly, sensitivities=[parameter])
    above, below = (hb.simulate(assembly, parameters={parameter: value + k * step}) for k in (1, -1))
    difference = (above[signal] - below[signal]) / (2 * step)
    found = run.sensitivity(signal, parameter)
    # along the run sensitivities are right to some 1e-4 of their largest value, at the start to rounding and the
    # curvature within the step
    largest = np.abs(difference).max()
    assert largest > 0 or signal == "supply.p"
    np.testing.assert_allclose(found[0], difference[0], rtol=1e-5, atol=1e-7 * largest + 1e-9)
    np.testing.assert_allclose(found, difference, rtol=1e-3, atol=1e-3 * largest + 1e-9)


# -- what was asked, what is used, and why ---------------------------------------------------------------------------------
def test_the_table_of_the_start_tells_what_was_asked_and_why() -> None:
    run = hb.simulate(hb.load(HARD / "load_hangs_still_at_a_pressure.yaml"))
    rows = {line.name: (line.asked, line.why) for line in run.start.table}
    assert rows["load.x"] == ("0.3 m", "asked for")
    assert rows["load.v"] == ("", "solved (steady)")
    assert rows["supply.p_0"] == ("solve", "solved for")
    used = {line.name: line.used for line in run.start.table}
    assert used["supply.p_0"] == pytest.approx(500 * 9.81 / 20e-4, rel=1e-9)
