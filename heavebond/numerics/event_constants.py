"""Constants of the integration through events, in one object."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class EventConstants:
    """The constants of the integration through events: localisation, repeated events, and limits that end a run without
    progress.

    first_stretch: output points of the first stretch after an event; each further stretch has twice as many. Origin:
        events follow each other. Doubled: fewer calls of the integrator, more of each discarded.
    max_stretch: output points of the longest stretch. Origin: memory of the dense output. Doubled: nothing measurable.
    min_checks: points at which conditions are checked in a run, at least; every output is one, and most follow the
        steps of the integrator (see `looks`). Origin: a condition on time alone takes no steps; its pulse of less than
        a thousandth of the run may be missed. Doubled: shorter pulses are found, more evaluations.
    mean_steps: steps of the integrator between two checks in a stretch, on the average, at most. Origin: at rtol 1e-8
        five steps are 0.3 rad of an oscillation, which a cubic follows to 2e-5 of the amplitude. Doubled: to 3e-4, half
        the evaluations.
    steps_per_check: the same between any two. Origin: 1 rad of an oscillation. Doubled: shorter pulses may be missed.
    first_checks: intervals of the first stretch after an event, where checks follow the steps. Origin: as many steps as
        the integrator takes to reach its order. Doubled: fewer calls, more of each discarded.
    first_parts: parts of the first interval of a stretch, each four times as long as the one before. Origin: the
        integrator doubles its first steps, from 1e-5 of the usual ones. Doubled: nothing.
    growth: factor by which the interval between two checks changes at most from one stretch to the next. Origin: a
        compromise of calls that fail and of checks too many. Doubled: nothing measurable.
    steps_at_begin: steps in which the integrator reaches its order, not counted in the average. Origin: measured.
        Doubled: after events fewer checks.
    shortest_interval: share of the run down to which checks follow the steps. Origin: a bound on the time of a crawling
        run. Doubled: pulses in such runs may be missed.
    approach: distance to a point that the integrator cannot pass, in instants (`same_instant`), up to which it is
        followed. Origin: one decade. Doubled: nothing in SI within 1e-11 of the run.
    crossing_precision: share of the distance at which two instants are one, to which a crossing is located. Origin:
        well within one instant. Doubled: nothing in SI within 1e-14 of the run.
    chattering_events: events of conditions within `chattering_within` of the run that are chattering. Origin: see
        `repeated_events`. Doubled: the error comes after twice as many events.
    repeated_events: the same for one condition. Origin: a ball that keeps 0.05 of its height reaches the rounding of
        time after as many hops. Doubled: some more hops are integrated.
    chattering_within: share of the run that counts as one instant of chattering. Origin: far above the rounding of
        time, far below any period. Doubled: faster oscillations are refused.
    sliding_events: events of conditions within `sliding_within` of the run that slide along a condition. Origin: five
        million of them would be needed for the whole run; a converter at 100 kHz over a second stays a factor of 25
        below. Doubled: the error comes later.
    sliding_within: share of the run for `sliding_events`. Origin: as there. Doubled: half of that rate of events is
        refused.
    dense_events: events of the conditions of one part within `dense_within` of the run that the verdict reports. Origin: a
        hundred thousand in the whole run, minutes of computation. Doubled: twice that rate is silent.
    dense_within: share of the run for `dense_events`. Origin: one output interval. Doubled: half of that rate is reported.
    many_events: events of the conditions of one part in the run that the verdict reports. Origin: they take longer than
        the motion of most machines between them. Doubled: twice as many are silent.
    share_of_steps: share of the steps of a method with a fixed step at whose ends conditions of one part set off events that
        the verdict reports. Origin: a switch that drives itself back acts at every step or at every second one. Doubled:
        such a switch is not named if it rests in a part of the run.
    max_crawls: halvings of a stretch without an event before a run that crawls is given up. Origin: a piston that has
        passed its stop empties its chamber. Doubled: such a run ends later.
    steps_in_chart: steps of the integrator between two points where other states may be chosen. Origin: a bound on the
        time of a crawling run. Doubled: the end of a choice of states is found later.
    steps_ahead: steps of the integrator where several points are integrated at once. Origin: beyond, an event is likely
        between them. Doubled: such a stretch is given up later.
    steps_between: steps of the integrator between two points, after which the run is given up. Origin: a run has a
        thousand points at least. Doubled: runs that crawl are given up later.
    steps_between_points: steps of the integrator between two points of the dense run (see `Result.dense`) where no condition
        is checked, on the average, from which on more points are made. Origin: 0.1 rad of an oscillation. Doubled: fewer
        calls are made again, extremes of oscillations have errors 16 times as large.
    max_points: points of the dense run in one call of the integrator, at most. Origin: memory. Doubled: twice of it.
    max_cascades: events that set off each other at one instant. Origin: a chain of as many relays. Doubled: the error
        of a circle comes later.
    impact_time: seconds within which the impulse of an impact acts on what gives way to it (friction that sticks, bodies
        at rest on each other); in a run of less than a second, this share of the run. Origin: machine parts touch for
        10 us to 1 ms. Doubled: friction holds against impulses twice as large, which are then passed on.
    reduced: share of its force that a contact at its limit keeps in the trial whether it moves. Origin: any share below 1
        serves, as accelerations are linear in forces. Doubled: no trial.
    held: share of the acceleration of a body without sticking contacts, below which others hold it. Origin: stuck contacts
        give way with 1e-12 of it, times the ratio of its mass to their typical mass. Doubled: nothing for masses up to
        10 million times the typical one.
    max_halvings: halvings of a step in which a choice of states ends. Origin: rounding of time. Doubled: nothing.
    nearer: halvings of a stretch without conditions at which too many steps are taken. Origin: a sixteenth of a stretch
        takes fewer than `steps_between` steps if ten times as many are enough for all of it. Doubled: more points.
    max_failures: failures of the integrator without an event between. Origin: a bound on the time of a run without
        progress. Doubled: a hopeless run ends later.
    max_solver_changes: changes of the solver in one run. Origin: a bound on the time of a run without progress.
        Doubled: a hopeless run ends later.
    continuous: share of its usual size by which a derivative may differ before and after an event and count as
        continuous. Origin: the square root of rounding. Doubled: nothing.
    jump_iterations: iterations to the algebraic unknowns after an event. Origin: they may be far away. Doubled: nothing
        measurable.
    crossing_iterations: iterations on a bracketed crossing. Origin: a bracket is halved to rounding in some 50.
        Doubled: nothing.
    same_instant: share of the run within which two instants are one. Origin: some thousand times the rounding of time.
        Doubled: nothing.
    same_roundings: the same in roundings of a time. Origin: a sum of a few terms. Doubled: nothing.
    max_time_events: instants of one time event in a run. Origin: memory; 1 kHz over a quarter of an hour. Doubled:
        longer runs of fast converters, twice the memory.
    """

    first_stretch: int = 8
    max_stretch: int = 1024
    min_checks: int = 1000
    mean_steps: float = 5.0
    steps_per_check: int = 20
    first_checks: int = 32
    first_parts: int = 8
    growth: float = 4.0
    steps_at_begin: int = 40
    shortest_interval: float = 1e-7
    approach: int = 10
    crossing_precision: float = 1e-2
    chattering_events: int = 30
    repeated_events: int = 4
    chattering_within: float = 1e-8
    sliding_events: int = 500
    sliding_within: float = 1e-4
    dense_events: int = 100
    dense_within: float = 1e-3
    many_events: int = 10_000
    share_of_steps: float = 0.25
    max_crawls: int = 5
    steps_in_chart: int = 5000
    steps_ahead: int = 3000
    steps_between: int = 30_000
    steps_between_points: float = 2.0
    max_points: int = 65_536
    max_cascades: int = 100
    impact_time: float = 1e-6
    reduced: float = 0.5
    held: float = 1e-4
    max_halvings: int = 40
    nearer: int = 4
    max_failures: int = 400
    max_solver_changes: int = 200
    continuous: float = 1e-7
    jump_iterations: int = 30
    crossing_iterations: int = 80
    same_instant: float = 1e-12
    same_roundings: int = 8
    max_time_events: int = 1_000_000


EVENTS = EventConstants()
