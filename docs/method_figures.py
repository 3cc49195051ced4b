"""Draw the figures of "How a step works" from the code itself, into docs/figures.

python docs/method_figures.py       (the site's build runs it)
"""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

import dashpot
from dashpot.figures import clean

FOLDER = Path(__file__).parent / "figures"
BLUE, ORANGE, GREY = "#0072b2", "#d55e00", "#777777"

BALL = """<mujoco><option timestep="{timestep}"/><worldbody>
  <geom name="floor" type="plane" size="5 5 .1"/>
  <body pos="0 0 {height}"><freejoint/><geom name="ball" size=".05" mass="1"/></body>
</worldbody></mujoco>"""
STACK = """<mujoco><option timestep="0.005"/><worldbody>
  <geom name="floor" type="plane" size="5 5 .1"/>{bodies}</worldbody></mujoco>"""
BOX = """<body pos="0 0 {height}"><freejoint/>
  <geom type="box" size=".05 .05 .05" mass="1"/></body>"""


def contact_flow() -> Figure:
    """Draw one hit in closed form, and the same in steps of 4 ms."""
    contact = {"stiffness": 1e4, "damping": 40.0, "inverse_mass": 1.0}
    time = np.linspace(0.0, 0.05, 401)
    whole = dashpot.law.flow_contact(0.004, -0.5, -9.81, time, **contact)
    gap, rate, steps = 0.004, -0.5, [(0.0, 0.004, 0.0)]
    for k in range(1, 13):
        part = dashpot.law.flow_contact(gap, rate, -9.81, 0.004, **contact)
        gap, rate = float(part.gap), float(part.rate)
        steps.append((0.004 * k, gap, float(part.force)))
    figure = Figure(figsize=(7.5, 2.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    at, gaps, forces = np.array(steps).T
    left.plot(1e3 * time, 1e3 * whole.gap, color=BLUE, label="closed form")
    left.plot(1e3 * at, 1e3 * gaps, "o", color=ORANGE, markersize=4, label="steps of 4 ms")
    left.axhline(0.0, color=GREY, linewidth=0.8)
    left.set(xlabel="time, ms", ylabel="gap g, mm")
    left.legend(frameon=False, fontsize="small")
    right.plot(1e3 * time, whole.force, color=BLUE)
    right.plot(1e3 * at, forces, "o", color=ORANGE, markersize=4)
    right.set(xlabel="time, ms", ylabel="force f, N")
    clean(left, right)
    return figure


def compression_as_state() -> Figure:
    """Draw overlap and compression of a ball that is put 4 mm into the floor."""
    model = mujoco.MjModel.from_xml_string(BALL.format(timestep=0.001, height=0.05))
    engine = dashpot.Engine(model)
    engine.set_pair_material("ball", "floor", dashpot.Material(1e4, damping_ratio=1.0))
    data = engine.make_data()
    engine.step(data, 500)
    rows = []
    for k in range(120):
        if k == 10:
            data.qpos[2] = 0.046
        engine.step(data)
        contacts = engine.contacts(data)
        rows.append((k, -1e3 * contacts.gap[0], 1e3 * contacts.compression[0]))
    time, overlap, compression = np.array(rows).T
    figure = Figure(figsize=(7.5, 2.6), layout="constrained")
    axes = figure.subplots()
    axes.plot(time, overlap, color=BLUE, label="overlap that collision reports")
    axes.plot(time, compression, color=ORANGE, label="compression of the spring")
    axes.fill_between(time, compression, overlap, color=GREY, alpha=0.2, linewidth=0)
    axes.annotate("unstressed offset:\nrecovers, stores nothing", (14, 2.0), (40, 2.2))
    axes.annotate("put 4 mm deep", (10, 4.0), (20, 3.7), arrowprops={"arrowstyle": "->"})
    axes.set(xlabel="time, ms", ylabel="mm", ylim=(0, 4.4))
    axes.legend(frameon=False, fontsize="small", loc="upper right")
    clean(axes)
    return figure


def coupling_bound() -> Figure:
    """Draw micro-steps that an engine takes, and those that the exact coupling asks for."""
    figure = Figure(figsize=(7.5, 3.0), layout="constrained")
    axes = figure.subplots()
    stiffness = np.geomspace(1e4, 1e7, 13)
    for boxes, colour in ((1, BLUE), (4, ORANGE)):
        bodies = "".join(BOX.format(height=0.05 + 0.1 * i) for i in range(boxes))
        model = mujoco.MjModel.from_xml_string(STACK.format(bodies=bodies))
        taken, asked = [], []
        for k in stiffness:
            engine = dashpot.Engine(model, max_microsteps=2000)
            material = dashpot.Material(float(k), damping_ratio=0.1)
            engine.set_materials(dict.fromkeys(range(model.ngeom), material))
            data = engine.make_data()
            engine.step(data, 400)  # it has come to rest
            taken.append(engine.step(data).microsteps)
            contact = engine.contact_material(0, 1)
            asked.append(exact_microsteps(coupling(engine, data), contact, 0.005))
        name = "a box" if boxes == 1 else f"a stack of {boxes}"
        axes.plot(stiffness, taken, "o-", color=colour, markersize=4, label=f"{name}, taken")
        axes.plot(stiffness, asked, "--", color=colour, label=f"{name}, exact")
    axes.set(xscale="log", yscale="log", xlabel="stiffness of a geom, N/m", ylabel="micro-steps")
    axes.set_yticks([13, 30, 100, 300], ["13", "30", "100", "300"])
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.legend(frameon=False, fontsize="small")
    clean(axes)
    return figure


def coupling(engine: dashpot.Engine, data: mujoco.MjData) -> np.ndarray:
    """Return J H^-1 J^T of all contacts, three rows each: a normal and two tangents."""
    jacobians = []
    mujoco.mj_forward(engine.model, data)
    for contact in data.contact:
        ends = []
        for geom in contact.geom:
            jacobian = np.zeros((3, engine.model.nv))
            body = engine.model.geom_bodyid[geom]
            mujoco.mj_jac(engine.model, data, jacobian, None, contact.pos, body)
            ends.append(jacobian)
        jacobians.append(contact.frame.reshape(3, 3) @ (ends[1] - ends[0]))
    rows = np.concatenate(jacobians)
    inertia = np.zeros((engine.model.nv, engine.model.nv))
    mujoco.mj_fullM(engine.model, data, inertia)
    return rows @ np.linalg.solve(inertia, rows.T)


def exact_microsteps(
    coupling: np.ndarray, contact: dashpot.ContactMaterial, timestep: float
) -> float:
    """Return the micro-steps that resolve stiffness and damping of all rows."""
    inverse_mass = np.diag(coupling).reshape(-1, 3)
    along = inverse_mass[:, 1:].mean(axis=1, keepdims=True)
    stiffness = contact.stiffness * np.array(
        [1.0, contact.tangential_ratio, contact.tangential_ratio]
    )
    ratio = [contact.damping_ratio] + 2 * [contact.tangential_damping_ratio]
    damping = (
        2 * np.array(ratio) * np.sqrt(stiffness / np.hstack([inverse_mass[:, :1], along, along]))
    )
    largest = []
    for diagonal in (np.broadcast_to(stiffness, damping.shape), damping):
        root = np.sqrt(diagonal.ravel())
        largest.append(np.linalg.eigvalsh(root[:, None] * coupling * root)[-1])
    return max(13.0, timestep / 0.6 * max(math.sqrt(largest[0]), largest[1]))


def limit_surface() -> Figure:
    """Draw trial impulses and where they return to."""
    mu, normal = np.array([0.6, 0.3]), 1.0
    figure = Figure(figsize=(5.2, 3.2), layout="constrained")
    axes = figure.subplots()
    angle = np.linspace(0.0, 2 * math.pi, 121)
    axes.plot(mu[0] * np.cos(angle), mu[1] * np.sin(angle), color=BLUE)
    axes.annotate("limit surface", (-0.53, 0.14), (-0.98, 0.36), color=BLUE)
    trials = [(0.9, 0.3), (0.5, 0.55), (-0.3, 0.55), (0.3, -0.5), (-0.75, -0.3), (0.25, 0.1)]
    for trial in trials:
        end, sticks = dashpot.law.return_to_limit(trial, mu, [1.0, 1.0], normal)
        axes.plot(*trial, "o", color=GREY, markersize=5)
        if not sticks:
            axes.annotate("", end, trial, arrowprops={"arrowstyle": "->", "color": ORANGE})
    axes.annotate("inside: sticks", (0.25, 0.1), (-0.32, 0.0), arrowprops={"arrowstyle": "->"})
    axes.annotate("trial impulse", (0.9, 0.3), (0.62, 0.42))
    axes.set(xlabel="$p_1 / p_n$", ylabel="$p_2 / p_n$", aspect="equal", xlim=(-1, 1.1))
    clean(axes)
    return figure


def timeline() -> Figure:
    """Draw one step of 5 ms in which a ball lands: what is asked when, and the force."""
    timestep, speed, gap, count = 0.005, 1.0, 0.0012, 13
    contact = {"stiffness": 2e5, "damping": 150.0, "inverse_mass": 1.0}
    time = np.linspace(0.0, timestep, 401)
    flow = dashpot.law.flow_contact(gap, -speed, -9.81, time, **contact)
    figure = Figure(figsize=(7.5, 3.2), layout="constrained")
    axes = figure.subplots()
    height = flow.force / flow.force.max()
    axes.fill_between(1e3 * time, 0, height, color=ORANGE, alpha=0.35, linewidth=0)
    axes.text(1.9, 0.35, "force of a contact\nthat begins in the step", fontsize="small")
    for k in range(count + 1):
        axes.plot([1e3 * timestep * k / count] * 2, [-0.12, 0], color=GREY, linewidth=0.8)
    axes.text(2.5, -0.3, "13 micro-steps", ha="center", fontsize="small")
    notes = {
        0.0: "positions, smooth forces,\ndetection, rows, islands",
        2.5: "geometry of contacts\nis that of the middle",
        5.0: "positions, report,\nmemory",
    }
    for at, text in notes.items():
        axes.annotate(text, (at, 1.05), (at, 1.3), ha="center", fontsize="small",
                      arrowprops={"arrowstyle": "->"})  # fmt: skip
    axes.annotate("", (0.0, -0.55), (-0.9, -0.55), arrowprops={"arrowstyle": "->"})
    axes.annotate("", (5.9, -0.55), (5.0, -0.55), arrowprops={"arrowstyle": "->"})
    axes.text(0.1, -0.62, "Verlet corrector of the last step", fontsize="small")
    axes.text(4.9, -0.62, "corrector, once its forces are known", ha="right", fontsize="small")
    axes.plot([0, 5], [0, 0], color="black", linewidth=1.5)
    axes.set(xlim=(-1.1, 6.1), ylim=(-0.8, 1.75), xlabel="time in the step, ms", yticks=[])
    axes.spines[["left", "top", "right"]].set_visible(False)
    return figure


def main() -> None:
    """Draw all of them."""
    FOLDER.mkdir(exist_ok=True)
    figures = (contact_flow, compression_as_state, coupling_bound, limit_surface, timeline)
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "dashpot", "font.size": 9}):
        for figure in figures:
            figure().savefig(FOLDER / f"{figure.__name__}.svg", metadata={"Date": None})


if __name__ == "__main__":
    main()
