"""Plots, drawings and animations."""

from __future__ import annotations

from typing import TYPE_CHECKING

from heavebond.core.facade import provides

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

    from heavebond.estimation.comparison import Comparison
    from heavebond.language.model import Model
    from heavebond.linear.linear_system import StateSpace
    from heavebond.linear.root_locus import RootLocus
    from heavebond.monitoring.monitor import Monitoring
    from heavebond.numerics.dae import Array
    from heavebond.numerics.output_times import Time
    from heavebond.numerics.result import Result
    from heavebond.optimise.influence import Rankings
    from heavebond.pictures.motion import Motion
    from heavebond.records.saved_runs import SavedRun
    from heavebond.records.signal_array import Signal
    from heavebond.records.spectra import SignalAnalysis
    from heavebond.studies.campaign import StudyResult


@provides("Model._repr_svg_")
def _drawing(model: Model) -> str:
    from heavebond.pictures.drawing import draw

    return draw(model)


@provides("Result.plot")
def _plot_of_run(result: Result, names: tuple[str, ...]) -> Figure:
    from heavebond.pictures.plot import plot_signals

    return plot_signals(result, names)


@provides("Signal.plot")
def _plot_of_signal(signal: Signal, time: Array) -> Figure:
    from heavebond.pictures.plot import plot_runs
    from heavebond.records.saved_runs import SavedRun

    name = signal.name or "signal"
    return plot_runs({name: SavedRun("", time, {name: signal.magnitude}, {name: signal.unit})}, [name])


@provides("SavedRun.plot")
def _plot_of_saved_run(run: SavedRun, names: tuple[str, ...]) -> Figure:
    from heavebond.pictures.plot import plot_runs

    return plot_runs({run.model: run}, names, title=run.model)


@provides("Comparison.plot")
def _plot_of_comparison(comparison: Comparison) -> Figure:
    from heavebond.pictures.plot import plot_comparison

    return plot_comparison(comparison)


@provides("RootLocus.plot")
def _plot_of_locus(locus: RootLocus) -> Figure:
    from heavebond.pictures.plot_linear import plot_root_locus

    return plot_root_locus(locus, title=f"poles over {locus.parameter}")


@provides("StateSpace.plot")
def _plot_of_state_space(system: StateSpace, picture: str) -> Figure:
    from heavebond.pictures.plot_linear import channels_figure

    return channels_figure(system, picture)


@provides("Rankings.plot")
def _plot_of_rankings(rankings: Rankings) -> Figure:
    from heavebond.pictures.plot import plot_influence

    return plot_influence(rankings, title=f"{rankings.model}: influence of parameters")


@provides("SignalAnalysis.plot")
def _plot_of_analysis(analysis: SignalAnalysis) -> Figure:
    from heavebond.pictures.plot_spectra import plot_spectra

    return plot_spectra([analysis])


@provides("StudyResult.plot")
def _plots_of_study(result: StudyResult) -> list[Figure]:
    from heavebond.pictures.plot_study import plot_study

    return [plot_study(result, picture) for picture in result.study.pictures]


@provides("Motion.save")
def _saved_motion(motion: Motion, path: Path, speed: float, at: Time | None) -> Path:
    from heavebond.pictures.animation import save_animation

    return save_animation(motion, path, speed=speed, at=at)


@provides("Motion._repr_html_")
def _page_of_motion(motion: Motion) -> str:
    from heavebond.pictures.animation import animation_frame

    return animation_frame(motion)


@provides("Monitoring.plot")
def _plot_of_monitored_record(monitoring: Monitoring, name: str) -> Figure:
    from heavebond.pictures.plot_monitor import plot_monitored

    return plot_monitored(monitoring, name)
