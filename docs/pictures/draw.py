"""Draws the pictures of the documentation with the program itself: `python docs/pictures/draw.py [FOLDER]`."""

from __future__ import annotations

import os
import re
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import heavebond as hb
from heavebond.core.presentation import number, unit_label
from heavebond.core.units import parse_range
from heavebond.energy_audit.power_flow import energy_flow
from heavebond.estimation.starter_folder import new as start_folder
from heavebond.language.model import find
from heavebond.optimise.objective import Objective
from heavebond.optimise.tuning import sweep, tune
from heavebond.pictures import plot, plot_energy, plot_linear
from heavebond.pictures.animation import save_animation
from heavebond.pictures.bond_picture import draw_bond_graph
from heavebond.pictures.colour_map import paint
from heavebond.pictures.motion import animate
from heavebond.pictures.plot_spectra import plot_spectra
from heavebond.pictures.plot_study import plot_study
from heavebond.pictures.plot_where import plot_place
from heavebond.records.spectra import SignalAnalysis, evenly
from heavebond.studies.study import load_study
from heavebond.studies.sweep import Sweep, read_over, study_text

# what `heavebond diagnose` writes for the rig of the first page
FOUND = {
    "rig_2.yaml": """model: rig_2
extends: rig.yaml
components:
  coulomb_friction: {is: CoulombFriction, F_c: 24.964 N}
nodes:
  deck: [+coulomb_friction.a]
  load: [+coulomb_friction.b]
set:
  spring.c: 4.19982 kN/m
  damper.d: 130.512 N*s/m
""",
    "measured_2.yaml": """experiment: rig, measured, with dry friction between deck and load
extends: measured.yaml
model: rig_2.yaml
"""}


def weight_on_bit(folder: Path) -> Path:
    """The published wave (0.5 m, 12 s), passive beside active, both with seal friction."""
    runs = {"passive": hb.simulate(hb.load("cmc_ahc/passive")).saved(), "active": hb.simulate(hb.load("cmc_ahc")).saved()}
    title = "Crown-mounted compensator, heave 0.5 m at 12 s"
    figure = plot.plot_runs(runs, ["WOB", "crown"], title=title, shaded=(72.0, 96.0))
    return plot.save(figure, folder / "passive_active.png")


def friction(folder: Path) -> Path:
    """The passive rig without friction beside its records."""
    return plot.save(plot.plot_comparison(hb.compare("passive_rig/friction")), folder / "friction.png")


def choked(folder: Path) -> Path:
    """The receiver without choked flow beside its records."""
    return plot.save(plot.plot_comparison(hb.compare("receiver_rig/choked")), folder / "choked.png")


def implied_friction(folder: Path) -> Path:
    """The force that the passive rig lacks between platform and crown, over the motion there."""
    found = hb.localize("passive_rig/friction")
    return plot.save(plot_place(found, found.suspects[0].place.name), folder / "implied_friction.png")


def session(folder: Path) -> list[Path]:
    """The rig of the first page: its diagram, and its records beside the model before and after."""
    with tempfile.TemporaryDirectory() as place:
        rig = Path(place) / "rig"
        start_folder(rig)
        for name, text in FOUND.items():
            (rig / name).write_text(text, encoding="utf-8")
        diagram = folder / "rig.svg"
        diagram.write_text(hb.draw(hb.load(rig / "rig.yaml")), encoding="utf-8")
        return [diagram, *(plot.save(plot.plot_comparison(hb.compare(rig / f"{name}.yaml")), folder / f"session_{when}.png")
                           for when, name in (("before", "measured"), ("found", "measured_2")))]


def tuning(folder: Path, points: int = 13) -> Path:
    """The cost over the two gains of the compensator with a slow valve, `points` along each, and the way of the search."""
    study = load_study("cmc_ahc/quality_index")
    problem = Objective(hb.assemble(study.model.with_parameters({"ahc.valve.f_n": "0.5 Hz"})), study.tuning)
    found = tune(problem, study.tuning)
    return plot.save(plot.plot_surface(study.tuning, found, *sweep(problem, [points, points])), folder / "tuning.png")


def compensator(folder: Path) -> Path:
    """The diagram of the compensator."""
    path = folder / "cmc_ahc.svg"
    path.write_text(hb.draw(hb.load("cmc_ahc")), encoding="utf-8")
    return path


def detailed(folder: Path) -> Path:
    """The compensator part by part."""
    path = folder / "cmc_detailed.svg"
    path.write_text(hb.draw(hb.load("cmc_ahc/detailed"), open=("cmc", "ahc")), encoding="utf-8")
    return path


def _of_study(name: str, folder: Path, file: str = "", points: int | None = None) -> Path:
    """The first picture of a study; with the first level of its inner axes, over so many levels of its last axis and without
    its tuning if `points` is given."""
    study = load_study(f"cmc_ahc/studies/{name}")
    if points is not None:
        *outer, last = study.axes
        axes = (*outer[:1], *(replace(axis, levels=axis.levels[:1]) for axis in outer[1:]),
                replace(last, levels=last.levels[:points]))
        study = replace(study, axes=axes, task=None, procedures=())
    result = hb.study(study, processes=1)
    return plot.save(plot_study(result, study.pictures[0]), folder / f"{file or name}.png")


def published_fig6(folder: Path) -> Path:
    """Weight on bit, passive, with and without friction."""
    return _of_study("fig6", folder, "published_fig6")


def published_fig8(folder: Path, points: int | None = None) -> Path:
    """Weight on bit, active with tuned gains, with and without friction."""
    return _of_study("fig8", folder, "published_fig8", points)


def mru_failure(folder: Path) -> Path:
    """Weight on bit and crown block after a failure of the motion reference unit."""
    return _of_study("mru_failure", folder)


def changeover(folder: Path, points: int | None = None) -> Path:
    """Highest pressure and weight on bit over the closing time of the bypass valve."""
    return _of_study("changeover", folder, points=points)


def accumulator(folder: Path, points: int | None = None) -> Path:
    """Weight on bit and swing of the gas pressure over the volume of the gas bottles."""
    return _of_study("accumulator", folder, points=points)


def sea_states(folder: Path, points: int | None = None) -> Path:
    """Weight on bit and stroke over the significant height; `points` heights and seeds, one level of the other axes, over
    two minutes."""
    study = load_study("cmc_ahc/studies/sea_states")
    if points is not None:
        study = replace(study, end=study.begin + 120.0, axes=tuple(replace(
            axis, levels=axis.levels[:1 if axis.unit is None and axis.sampling is None else points]) for axis in study.axes))
    return plot.save(plot_study(hb.study(study), study.pictures[0]), folder / "sea_states.png")


def bode(folder: Path) -> Path:
    """Crown and string force of the passive rig over the motion of the platform."""
    system = hb.state_space(hb.load("passive_rig"), ["vessel.u"], ["crown.x", "string_force"])
    channels = [system.channel(name, "vessel.u") for name in system.outputs]
    return plot.save(plot_linear.plot_bode(channels, channels[0].frequencies(), title="passive_rig at its start"),
                     folder / "bode.png")


def locus(folder: Path) -> Path:
    """The poles of the compensator over its position gain."""
    found = hb.root_locus(hb.load("cmc_ahc"), "controller.K_p", parse_range("0 .. 8 1/m"))
    return plot.save(plot_linear.plot_root_locus(found, title="cmc_ahc: poles over controller.K_p"), folder / "locus.png")


def flow(folder: Path) -> Path:
    """The energy of the compensator in its wave."""
    found = hb.energy(hb.load("cmc_ahc"))
    return plot.save(plot_energy.plot_energy_flow(energy_flow(found), title="cmc_ahc: energy over 96 s"),
                     folder / "energy_flow.png")


def coloured(folder: Path) -> list[Path]:
    """The loader coloured by the power that its parts pass on, and its bond graph."""
    model = hb.load("hydrostatic_drive")
    pictures = {"power.svg": hb.draw(model, colour=paint(model, "power")), "bonds.svg": draw_bond_graph(model)}
    for name, picture in pictures.items():
        (folder / name).write_text(picture, encoding="utf-8")
    return [folder / name for name in pictures]


def overlaid(folder: Path) -> Path:
    """The quarter car with two dampers over each other."""
    car = hb.load("quarter_car")
    runs = {"soft": hb.simulate(car).saved(), "stiff": hb.simulate(car.with_parameters({"damper.d": "3 kN*s/m"})).saved()}
    return plot.save(plot.plot_runs(runs, ["body.x", "comfort"]), folder / "overlaid.png")


def moving(folder: Path) -> Path:
    """The boom of the excavator as it is lifted."""
    return save_animation(animate(hb.load("excavator_boom"), "6 s"), folder / "boom.gif")


def mechanism(folder: Path) -> Path:
    """The slider-crank of the page on mechanisms, four times as slow as it runs."""
    page = (Path(__file__).parent.parent / "mechanisms.md").read_text("utf-8")
    found = re.search(r"<!-- file: slider_crank\.yaml -->\n```yaml\n(.*?)```", page, re.DOTALL)
    assert found is not None
    return save_animation(animate(hb.loads(found.group(1)), "0.65 s"), folder / "mechanism.gif", speed=0.25)


def crane(folder: Path) -> Path:
    """The crane of the page on mechanisms, three times as fast as it runs."""
    return save_animation(animate(hb.load("mechanisms/crane"), "15 s"), folder / "crane.gif", speed=3)


def imported_robot(folder: Path) -> Path:
    """The robot from URDF of the page on mechanisms in space."""
    page = (Path(__file__).parent.parent / "spatial.md").read_text("utf-8")
    found = re.search(r"<!-- file: reach\.yaml -->\n```yaml\n(.*?)```", page, re.DOTALL)
    assert found is not None
    with tempfile.TemporaryDirectory() as temporary:
        hb.import_model("spatial/bench_arm.urdf", Path(temporary) / "bench_arm")
        (Path(temporary) / "reach.yaml").write_text(found.group(1), "utf-8")
        return save_animation(animate(hb.load(Path(temporary) / "reach.yaml"), "2 s"), folder / "bench_arm.png", at="2 s")


def in_space(folder: Path, points: int | None = None) -> list[Path]:
    """The robot arm in motion, the platform on its cylinders, the crane after its landing (or after `points` s), and the
    crane on a barge with its load lifted."""
    seconds, lifted = (66, 18) if points is None else (points, 0.1)
    gyroscope = hb.load("spatial/gyroscope")
    others = {f"wheel.m={m}": animate(gyroscope, "2 s", parameters={"wheel.m": m}) for m in ("3 kg", "1 kg")}
    return [save_animation(animate(hb.load("spatial/robot_arm"), "2.4 s"), folder / "robot_arm.gif"),
            save_animation(animate(gyroscope, "2 s").with_runs(others), folder / "gyroscope_masses.png", at="2 s"),
            save_animation(animate(hb.load("spatial/platform"), "1 s"), folder / "platform.png", at="1 s"),
            save_animation(animate(hb.load("spatial/landing_crane"), f"{seconds} s"), folder / "landing_crane.png",
                           at=f"{seconds} s"),
            save_animation(animate(hb.load("spatial/barge_crane"), f"{lifted} s"), folder / "barge_crane.png",
                           at=f"{lifted} s")]


def swept(folder: Path) -> list[Path]:
    """The compensator over its two gains, and what of the quarter car moves its comfort."""
    asked = {
        "map": Sweep(find("cmc_ahc"), (read_over("controller.K_p=1 .. 3 1/m; 5"),
                                       read_over("controller.K_v=0.4 .. 0.7 s/m; 4")), (("rms(crown)", "mm"),),
                     window=("72 s", "")),
        "tornado": Sweep(find("quarter_car"), tuple(map(read_over, (
            "damper.d=1.5 kN*s/m +- 30 %", "spring.c=22 kN/m +- 20 %", "tyre.c=190 kN/m +- 20 %", "body.m=320 kg +- 25 %"))),
            (("rms(comfort)", "m/s**2"),), "one_at_a_time")}
    drawn = []
    with tempfile.TemporaryDirectory() as place:
        for name, one in asked.items():
            study = Path(place) / f"{name}.yaml"
            study.write_text(study_text(one, Path(place)), encoding="utf-8")
            result = hb.study(study, processes=1)
            picture = next(p for p in result.study.pictures if p.kind == name)
            drawn.append(plot.save(plot_study(result, picture), folder / f"sweep_{name}.png"))
    return drawn


def sea(folder: Path) -> Path:
    """The platform and the crown block in an irregular sea: course, spectrum, cycles."""
    run = hb.simulate(hb.load("cmc_ahc/irregular_sea"), 300.0)
    seen = run.time >= 60.0
    found = [SignalAnalysis(evenly(name, run.unit(name), run.time[seen], run.display[name][seen]))
             for name in ("platform", "crown")]
    return plot.save(plot_spectra(found), folder / "sea.png")


def power_unit(folder: Path) -> Path:
    """A power unit whose oil carries its temperature."""
    path = folder / "power_unit.svg"
    path.write_text(hb.draw(hb.load("power_unit")), encoding="utf-8")
    return path


def measured(folder: Path) -> list[Path]:
    """The diagrams of the page on measured quantities, with the reading of each sensor at the end of the run."""
    page = (Path(__file__).parent.parent / "measured_quantities.md").read_text("utf-8")
    drawn = []
    for name, text in re.findall(r"<!-- file: (measured_\w+)\.yaml -->\n```yaml\n(.*?)```", page, re.DOTALL):
        model = hb.loads(text)
        final = hb.simulate(model).display
        readings = {output.name.partition(".")[0]: f"{number(float(final[output.name][-1]), 3)} {unit_label(output.unit)}"
                    for output in reversed([*model.show.values()]) if output.name.count(".") == 1}
        drawn.append(folder / f"{name}.svg")
        drawn[-1].write_text(hb.draw(model, highlight=readings, values=True), encoding="utf-8")
    return drawn


def monitored(folder: Path) -> Path:
    """The record with a leak of the tutorial on machines in service."""
    page = (Path(__file__).parent.parent / "tutorials" / "monitoring.md").read_text("utf-8")
    experiment, program = (re.findall(rf"```{kind}\n(.*?)```", page, re.DOTALL)[0] for kind in ("yaml", "python"))
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as place:
        os.chdir(place)
        try:
            Path("service.yaml").write_text(experiment, encoding="utf-8")
            exec(program, {})
            found = hb.monitor("service.yaml", "records", processes=1)
        finally:
            os.chdir(before)
    return plot.save(found.plot("wednesday"), folder / "monitored.png")


def reliability(folder: Path) -> Path:
    """Stated probabilities of a diagnosis against true frequencies, in the cases of the calibration study."""
    from benchmarks.diagnosis.reliability import diagram, known_rows, left_out

    rows, path = known_rows(), folder / "reliability.png"
    return plot.save(diagram(rows, left_out(rows)), path) if rows else path


def shortest_motion(folder: Path) -> Path:
    """The shortest motion of the axis on the page on optimal motion."""
    page = (Path(__file__).parent.parent / "optimal_motion.md").read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as place:
        for name, text in re.findall(r"<!-- file: (\w+\.yaml) -->\n```yaml\n(.*?)```", page, re.DOTALL):
            (Path(place) / name).write_text(text, encoding="utf-8")
        study = load_study(Path(place) / "shortest.yaml")
        assert study.optimal is not None
        best = hb.optimal(study.model, study.optimal)
    runs = {"run": best.run.saved(["load", "twist", "force"]), "collocation": best.trajectory}
    return plot.save(plot.plot_runs(runs, ["load", "twist", "force"], title=study.name), folder / "shortest_motion.png")


DRAWN = (
    weight_on_bit,
    shortest_motion,
    friction,
    choked,
    implied_friction,
    published_fig6,
    published_fig8,
    mru_failure,
    changeover,
    accumulator,
    sea_states,
    bode,
    locus,
    flow,
    session,
    tuning,
    compensator,
    coloured,
    overlaid,
    moving,
    mechanism,
    crane,
    in_space,
    imported_robot,
    swept,
    sea,
    detailed,
    measured,
    power_unit,
    monitored,
    reliability,
)

if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    for draw in DRAWN:
        drawn = draw(target)
        for path in drawn if isinstance(drawn, list) else [drawn]:
            print(f"wrote {path}")
