"""State machines with named states: their times in closed form, their checks, drawings and exports."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from test_c_events import agree
from test_export import compiled

import heavebond as hb
from heavebond.core.errors import HeavebondError
from heavebond.numerics.dae import assemble
from heavebond.reports.summary import summary

CHART = """
component: Chart
summary: A state machine.
ports:
  a: {signal: in, unit: m, doc: position}
  y: {signal: out, unit: m/s, doc: speed}
parameters:
  v: {unit: m/s, default: 2 m/s, doc: speed}
  h: {unit: m, default: 0.5 m, doc: limit}
  T: {unit: s, default: 0.5 s, doc: time}
variables:
  n: {unit: 1, held: 0, doc: number of entries}
"""
DIAGRAM = """
model: machine
components:
  chart: {is: Chart, a: "=1 m*sin(2*pi*time/(4 s))"}
show: {speed: {is: chart.y, unit: m/s}, entries: {is: chart.n, unit: 1}}
simulate: {until: 10 s, every: 100 ms}
"""
# the position rises through 0.5 m at 1/3 s and falls through it at 5/3 s, with the period 4 s
WAIT_AND_GO = """states:
  wait: {entry: {y: 0}, to: {go: a > h}}
  go:   {entry: {y: v, n: n + 1}, to: {wait: {when: a < h, after: T}}}
"""


def model(folder: Path, states: str, diagram: str = DIAGRAM) -> hb.Model:
    (folder / "chart.yaml").write_text(CHART + states)
    (folder / "machine.yaml").write_text(diagram)
    return hb.load(folder / "machine.yaml")


def times(run: hb.Result, event: str) -> list[float]:
    return [time for time, name in run.events if name == f"chart.{event}"]


def problem(folder: Path, states: str) -> HeavebondError:
    with pytest.raises(HeavebondError) as caught:
        hb.simulate(model(folder, states))
    return caught.value


def test_transitions_follow_their_conditions(tmp_path: Path) -> None:
    run = hb.simulate(model(tmp_path, WAIT_AND_GO))
    # crossings are located to the tolerance of the input, a function of time: to rounding
    assert times(run, "wait_to_go") == pytest.approx([1 / 3, 13 / 3, 25 / 3], abs=1e-9)
    assert times(run, "go_to_wait") == pytest.approx([5 / 3, 17 / 3, 29 / 3], abs=1e-9)
    assert (run["chart.go"] == (run["chart.state"] == 2)).all()
    assert (run["chart.y"] == 2.0 * run["chart.go"]).all()
    assert run["chart.n"][-1] == 3


def test_a_state_lasts_for_its_time(tmp_path: Path) -> None:
    """After 2 s in `go` the condition holds already at 7/3 s; the sensitivity of this time to T is 1."""
    run = hb.simulate(model(tmp_path, WAIT_AND_GO.replace("after: T", "after: 4*T")), sensitivities=["chart.T"])
    assert times(run, "go_to_wait") == pytest.approx([1 / 3 + 2, 13 / 3 + 2], abs=1e-9)
    assert run.event_sensitivity("chart.go_to_wait", 0, "chart.T") == pytest.approx(4.0, abs=1e-9)


def test_a_condition_that_is_true_at_the_start_lets_its_transition_happen(tmp_path: Path) -> None:
    for begin in (0.0, -7.0, 1e6):
        text = DIAGRAM.replace("until: 10 s", f"from: {begin} s, until: {begin + 0.3} s")
        run = hb.simulate(model(tmp_path, WAIT_AND_GO.replace("go: a > h", "go: a < 4*h"), text))
        assert times(run, "wait_to_go") == [begin]


def test_a_diagram_may_begin_in_another_state(tmp_path: Path) -> None:
    text = DIAGRAM + "initial: {chart.state: 2}\n"
    run = hb.simulate(model(tmp_path, WAIT_AND_GO, text))
    assert run["chart.y"][0] == 2.0
    assert times(run, "go_to_wait")[0] == pytest.approx(5 / 3, abs=1e-9)  # the position is above the limit at 0.5 s
    assert "chart begins in 'go' of wait, go" in summary(assemble(hb.load(tmp_path / "machine.yaml")), None).text()
    with pytest.raises(HeavebondError, match=r"'chart\.state' is the number or the name of a state"):
        hb.simulate(model(tmp_path, WAIT_AND_GO, DIAGRAM + "initial: {chart.state: 1.5}\n"))


def test_a_diagram_begins_in_a_state_by_its_name(tmp_path: Path) -> None:
    by_number, by_name = (hb.simulate(model(tmp_path, WAIT_AND_GO, DIAGRAM + f"initial: {{chart.state: {state}}}\n"))
                          for state in ("2", "go"))
    assert by_name.events == by_number.events and by_name["chart.y"][0] == 2.0
    for wrong, message in (("goo", "chart has no state 'goo'"), ("=go", "plain quantity"), ("~ go", "'go' is not a number")):
        with pytest.raises(HeavebondError, match=message):
            hb.simulate(model(tmp_path, WAIT_AND_GO, DIAGRAM + f'initial: {{chart.state: "{wrong}"}}\n'))
    with pytest.raises(HeavebondError, match=r"chart\.n: 'go' is not a number"):
        hb.simulate(model(tmp_path, WAIT_AND_GO, DIAGRAM + "initial: {chart.n: go}\n"))


def test_the_first_of_several_transitions_at_one_instant_happens(tmp_path: Path) -> None:
    """Conditions that become true together, by a motion and by the change of state."""
    for first, second in (("left", "right"), ("right", "left")):
        run = hb.simulate(model(tmp_path, f"""states:
  wait:  {{entry: {{y: 0}}, to: {{{first}: a > h, {second}: a > h}}}}
  left:  {{entry: {{y: v, n: n + 1}}, to: {{wait: a < h}}}}
  right: {{entry: {{y: -v, n: n + 10}}, to: {{wait: a < h}}}}
"""))
        assert {name.partition("_to_")[2] for _, name in run.events if "wait_to" in name} == {first}
        assert run["chart.n"][-1] == (3 if first == "left" else 30)
        run = hb.simulate(model(tmp_path, f"""states:
  idle:  {{entry: {{y: 0}}, to: {{wait: a > h}}}}
  wait:  {{to: {{{first}: a > 0.8*h, {second}: a > 0.6*h}}}}
  left:  {{entry: {{n: 1}}}}
  right: {{entry: {{n: 2}}}}
"""))
        assert run["chart.n"][-1] == (1 if first == "left" else 2)


def test_an_output_keeps_what_the_last_state_set(tmp_path: Path) -> None:
    """On entry of `go` the output is the position over T at that instant, and `stay` does not change it."""
    run = hb.simulate(model(tmp_path, """states:
  wait: {entry: {y: v}, to: {go: a > h}}
  go:   {entry: {y: a/T, n: n + 1}, to: {stay: {after: T}}}
  stay: {to: {wait: {after: 2*T}}}
"""))
    level = 0.5 / 0.5
    later = run.time > 1 / 3
    before = run.time < 1 / 3 + 1.5
    assert run["chart.y"][~later] == pytest.approx(2.0)
    assert run["chart.y"][later & before] == pytest.approx(level, abs=1e-9)
    assert run["chart.y"][(run.time > 1 / 3 + 1.5) & (run.time < 13 / 3)] == pytest.approx(2.0)


def test_an_output_is_zero_until_a_state_sets_it(tmp_path: Path) -> None:
    run = hb.simulate(model(tmp_path, """states:
  wait: {to: {go: a > h}}
  go:   {entry: {y: v, n: n + 1}}
"""))
    assert (run["chart.y"] == np.where(run.time > 1 / 3, 2.0, 0.0)).all()


def test_a_state_does_not_set_a_list_of_outputs(tmp_path: Path) -> None:
    (tmp_path / "chart.yaml").write_text((CHART + WAIT_AND_GO).replace("unit: m/s, doc: speed}\nparameters", "unit: m/s, "
                                         "count: 2, doc: speed}\nparameters"))
    (tmp_path / "machine.yaml").write_text(DIAGRAM)
    with pytest.raises(HeavebondError, match="y is a list"):
        hb.simulate(hb.load(tmp_path / "machine.yaml"))


def test_transitions_without_time_do_not_go_round(tmp_path: Path) -> None:
    """By a position that rises through the limit, and by one that steps beyond it."""
    states = WAIT_AND_GO.replace("{when: a < h, after: T}", "a > 0.8*h")
    assert "'chart.wait_to_go' happens 4 times within" in str(problem(tmp_path, states))
    with pytest.raises(HeavebondError) as caught:
        hb.simulate(model(tmp_path, states, DIAGRAM.replace("1 m*sin(2*pi*time/(4 s))", "if_else(time < 1 s, 0 m, 1 m)")))
    assert "'chart.wait_to_go' and 'chart.go_to_wait' set off each other without end, at t = 1 s" in str(caught.value)
    assert "`{when: ..., after: T}`" in str(caught.value)


@pytest.mark.parametrize(("wrong", "right", "code", "words"), [
    ("go: a > h", "goo: a > h", "state-unknown", "Did you mean 'go'"),
    ("wait: {when: a < h, after: T}", "go: a < h", "state-itself", "leads to itself without a delay"),
    ("{when: a < h, after: T}", "{}", "state-transition", "has no condition and no time"),
    ("y: 0", "y: T", "units-differ", "'y' is in m/s, its new value is in s"),
    ("a < h", "a < v", "units-differ", "'<' joins m and m/s"),
    ("a > h", "a", "condition-form", "a condition is a comparison"),
    ("after: T", "after: v", "units-differ", "`after:` is a time"),
    ("y: 0", "a: 0", "state-entry", "no output and no held variable"),
    ("y: 0", "y: a/T", "state-start", "must follow from parameters"),
    ("wait:", "n:", "state-name", "'n' is declared"),
])
def test_mistakes_in_a_state_machine(wrong: str, right: str, code: str, words: str, tmp_path: Path) -> None:
    error = problem(tmp_path, WAIT_AND_GO.replace(wrong, right))
    assert code in [p.code for p in error.problems]
    assert words in str(error)


def test_a_state_that_no_transition_reaches(tmp_path: Path) -> None:
    error = problem(tmp_path, WAIT_AND_GO + "  lost: {entry: {y: 0}, to: {wait: {after: T}}}\n")
    assert "no transition leads from 'wait', the first state, to 'lost'" in str(error)
    assert "two states at least" in str(problem(tmp_path, "states:\n  wait: {entry: {y: 0, n: 1}}\n"))


def test_a_state_machine_is_drawn_with_its_states(tmp_path: Path) -> None:
    machine = model(tmp_path, WAIT_AND_GO)
    picture = hb.draw(machine)
    for words in ("wait", "y = v", "n = n + 1", "go: a &gt; h", "wait: a &lt; h after T"):
        assert f">{words}</text>" in picture
    # a line and a head for each transition and for the start
    assert picture.count(" z\"") >= 3


@compiled
def test_a_state_machine_runs_in_c_as_here(tmp_path: Path) -> None:
    agree(model(tmp_path, WAIT_AND_GO), tmp_path)
    other = tmp_path / "other"
    other.mkdir()
    agree(model(other, """states:
  wait:  {entry: {y: 0}, to: {right: a > h, left: a > h}}
  left:  {entry: {y: v, n: n + 1}, to: {wait: a < h}}
  right: {entry: {y: a/T, n: n + 10}, to: {wait: {when: a < h, after: 3*T}}}
"""), other)


@compiled
def test_a_state_machine_runs_in_an_fmu_as_here(tmp_path: Path) -> None:
    from test_fmu_events import fmpy

    from heavebond.exchange.fmu_export import export_fmu

    machine = model(tmp_path, WAIT_AND_GO)
    path = tmp_path / "machine.fmu"
    export_fmu(machine, path)
    found = fmpy.simulate_fmu(str(path), stop_time=10.0, output_interval=0.1)
    run = hb.simulate(machine)
    away = np.array([min(abs(t - e) for e, _ in run.events) > 1e-6 for t in found["time"]])
    assert np.interp(found["time"][away], run.time, run["chart.n"]) == pytest.approx(found["entries"][away])
