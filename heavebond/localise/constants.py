"""Constants of the estimation of unknown inputs, in one object."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class InputEstimationConstants:
    """The constants of the estimation of unknown inputs (Kalman smoother) and of their places.

    parallel: distance from 1 of the squared cosine of two responses below which their places are one. Origin: a thousand
        samples cannot distinguish less. Doubled: nothing but for nearly equal places.
    unseen: response to a nominal input, over the noise, below which a place is not observable. Origin: rounding of the
        linearisation. Doubled: nothing.
    stepwise_below: reduced chi-square that parameters alone are predicted to leave, below which they are fitted step by step
        first. Origin: beyond, the linearised prediction is too far off. Doubled: more such fits, some seconds.
    max_steps: steps of that fit. Origin: it converges or is not worth more. Doubled: a little time.
    max_rounds: rounds of runs and estimates. Origin: a bound on the time. Doubled: twice the time.
    as_predicted: relative difference of chi-square up to which a run came out as predicted. Origin: the linearisation is
        good to some percent. Doubled: `foreseen` also holds for machines that are less linear.
    small_misfit: share of the misfit left below which the prediction is accepted. Origin: below noise. Doubled: nothing.
    level: significance level of a gain in likelihood. Origin: 1 % over all places. Doubled: twice as many false places in
        sound models.
    first_input: standard deviation of the input at the first sample, in its sizes. Origin: a diffuse prior. Doubled:
        nothing.
    start_deviation: standard deviation of an initial value, as a share of the span of its state. Origin: sensors and
        settling of records. Doubled: more misfit at the start is ascribed to it.
    range_deviation: standard deviation of a free parameter, as a share of its range (of its logarithm). Origin: a uniform
        distribution has 0.29. Doubled: more misfit is ascribed to parameters.
    max_places: groups of places that are estimated in full. Origin: more are never reported. Doubled: twice the time.
    explains: R2 from which a variable explains a force. Origin: half of its variance. Doubled: no variable is ever named.
    distinct: gap in log likelihood that separates two groups of places. Origin: twice the bound of very strong evidence, 2
        ln B = 10 (R. E. Kass, A. E. Raftery, 1995). Doubled: more places are reported as equally likely.
    sections: sections of a record that are compared. Origin: readability. Doubled: shorter sections.
    least_r2: R2 below which a variable of the error is not reported, however significant. Origin: of no practical use.
        Doubled: fewer variables.
    still: motion of a signal, over its usual size, below which it is constant. Origin: tolerances of runs. Doubled: nothing.
    rate_window: part of its mean period over which the rate of an estimated signal is taken. Origin: cubics are exact to a
        percent there. Doubled: accelerations with more of the errors of the estimate.
    max_regressors: variables around a place that are tried. Origin: time; they are ordered by nearness. Doubled: farther
        variables are tried.
    """

    parallel: float = 1e-6
    unseen: float = 1e-6
    stepwise_below: float = 20.0
    max_steps: int = 4
    max_rounds: int = 2
    as_predicted: float = 0.05
    small_misfit: float = 1e-3
    level: float = 0.01
    first_input: float = 10.0
    start_deviation: float = 0.02
    range_deviation: float = 0.25
    max_places: int = 4
    explains: float = 0.5
    distinct: float = 10.0
    sections: int = 12
    least_r2: float = 0.05
    still: float = 1e-9
    rate_window: float = 6.0
    max_regressors: int = 14


INPUT_ESTIMATION = InputEstimationConstants()
