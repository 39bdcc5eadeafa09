"""Records of an arm on two joints by MuJoCo: `python -m benchmarks.pan_tilt_records` writes those of the experiments
`spatial/pan_tilt_friction` and `spatial/pan_tilt_centre` into models/spatial/data.

MuJoCo reads the arm from spatial/pan_tilt.urdf and integrates it by Runge-Kutta steps of 0.2 ms, with the torques of the
records, in which each joint is driven by sines of several frequencies. In the records of the friction the tilting joint has
Coulomb friction (`frictionloss`); in those of the centre of mass the arm is 20 mm longer than the diagram says. The angles
have white noise.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

FOLDER = Path(__file__).parent.parent / "models/spatial/data"
STEP, EVERY, END = 2e-4, 0.02, 16.0
NOISE = 1e-3  # rad
FRICTION, EXCESS = 0.4, 0.02  # N*m, m
# amplitude (N*m), frequency (Hz) and phase (rad) of the sines of the torques
PAN = {"train": ((2.0, 0.9, 0.0), (1.5, 0.37, 1.0)), "validate": ((2.5, 0.7, 0.5), (1.0, 1.3, 2.0))}
TILT = {"train": ((2.0, 0.5, 0.0), (1.5, 1.2, 0.7)), "validate": ((1.6, 0.7, 1.2), (2.0, 0.3, 0.0))}
def torque(sines: tuple[tuple[float, float, float], ...], t: float) -> float:
    """A sum of sines that begins smoothly."""
    return float((1 - np.exp(-(t/0.3)**2))*sum(a*np.sin(2*np.pi*f*t + phase) for a, f, phase in sines))


def record(use: str, friction: float, centre: float, seed: int) -> np.ndarray:
    """Time, both torques and both angles (n, 5)."""
    model = mujoco.MjModel.from_xml_path(str(FOLDER.parent / "pan_tilt.urdf"))
    model.opt.timestep, model.opt.integrator = STEP, mujoco.mjtIntegrator.mjINT_RK4
    tilt = model.joint("tilt").dofadr[0]
    model.dof_frictionloss[tilt] = friction  # with constraints that are nearly rigid
    model.dof_solref[tilt], model.dof_solimp[tilt, :3] = (0.001, 1), (0.9999, 0.99999, 0.001)
    model.body("arm").ipos[0] = centre
    data = mujoco.MjData(model)
    data.qpos[:] = 0, np.pi/2
    rows, rng = [], np.random.default_rng(seed)
    for k in range(round(END/STEP) + 1):
        t = k*STEP
        if k % round(EVERY/STEP) == 0:
            rows.append([t, torque(PAN[use], t), torque(TILT[use], t), *(data.qpos + NOISE*rng.standard_normal(2))])
        data.qfrc_applied[:] = torque(PAN[use], t + STEP/2), torque(TILT[use], t + STEP/2)  # constant during a step
        mujoco.mj_step(model, data)
    return np.array(rows)


def main() -> None:
    FOLDER.mkdir(exist_ok=True)
    for k, (name, friction, centre) in enumerate((("friction", FRICTION, 0.25), ("centre", 0.0, 0.25 + EXCESS))):
        for use in ("train", "validate"):
            np.savetxt(FOLDER / f"{name}_{use}.csv", record(use, friction, centre, 2*k + (use == "validate")), fmt="%.7g",
                       delimiter=",", header="time_s,pan_Nm,tilt_Nm,pan_rad,tilt_rad", comments="")


if __name__ == "__main__":
    main()
