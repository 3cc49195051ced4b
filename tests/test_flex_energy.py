"""Elastic energy of flexes: its gradient is MuJoCo's spring force, and the ledger has it."""

import mujoco
import numpy as np
import pytest

import dashpot

SHEET = 'type="grid" count="4 4 1" spacing=".06 .06 .06" dim="2"'
BLOCK = 'type="grid" count="3 3 3" spacing=".06 .06 .06" dim="3"'
LINE = 'type="grid" count="5 1 1" spacing=".06 .06 .06" dim="1"'
ELASTIC = '<elasticity young="1e4" poisson=".3" thickness="1e-2" elastic2d="{}"/>'


def gutter(count=5):
    """MJCF of a shell that is bent about one axis at rest."""
    angle, along = np.meshgrid(0.3 * np.arange(count), 0.03 * np.arange(count), indexing="ij")
    points = np.stack([0.1 * np.sin(angle), 0.1 * (1 - np.cos(angle)), along], axis=-1)
    corner = np.array([count * i + j for i in range(count - 1) for j in range(count - 1)])
    lower = np.stack([corner, corner + 1, corner + count], axis=1)
    upper = np.stack([corner + 1, corner + count + 1, corner + count], axis=1)
    triangles = np.concatenate([lower, upper])
    return (
        f'type="direct" dim="2" point="{" ".join(map(str, points.ravel()))}" '
        f'element="{" ".join(map(str, triangles.ravel()))}"'
    )


def flex(name, shape, inner, position="0 0 0"):
    return f"""<flexcomp name="{name}" {shape} pos="{position}" mass=".2" radius=".002">
      <contact selfcollide="none"/>{inner}</flexcomp>"""


def engine_of(*flexes, timestep=1e-3, more=""):
    return dashpot.Engine(
        mujoco.MjModel.from_xml_string(
            f"""<mujoco><option timestep="{timestep}"/><worldbody>{more}{"".join(flexes)}
            </worldbody></mujoco>"""
        )
    )


@pytest.mark.parametrize(
    ("shape", "inner"),
    [
        (SHEET, ELASTIC.format("bend")),
        (SHEET, ELASTIC.format("stretch")),
        (SHEET, ELASTIC.format("both")),
        (gutter(), ELASTIC.format("both")),
        (BLOCK, ELASTIC.format("none")),
        (LINE, '<edge stiffness="50"/>'),
    ],
    ids=["bent", "stretched", "both", "gutter", "block", "line"],
)
def test_springs_of_flexes_are_the_gradient_of_the_potential(shape, inner):
    other = flex("other", SHEET, ELASTIC.format("both"), "0 0 1")  # addresses beyond the first
    engine = engine_of(other, flex("soft", shape, inner))
    engine.model.opt.gravity[:] = 0.0
    data = engine.make_data()
    rng = np.random.default_rng(0)
    start = data.qpos + rng.normal(size=engine.model.nq) * 5e-3
    data.qpos[:] = start
    mujoco.mj_forward(engine.model, data)
    force = data.qfrc_spring.copy()
    for _ in range(20):
        way = rng.normal(size=engine.model.nq)
        potential = []
        for side in (1e-6, -1e-6):
            data.qpos[:] = start + side * way
            potential.append(engine.energy(data).potential)
        change = (potential[0] - potential[1]) / 2e-6
        assert change == pytest.approx(-force @ way, abs=1e-6 * np.abs(force).max())


@pytest.mark.parametrize("damping", [0.0, 0.01])
def test_the_ledger_of_a_cloth_that_falls_on_a_ball_is_balanced(damping):
    inner = ELASTIC.format("both").replace("/>", f' damping="{damping}"/>')
    ball = '<geom size=".15" pos="0 0 .2"/>'
    errors = []
    for timestep in (1e-3, 2.5e-4):
        cloth = flex("cloth", SHEET, inner, "0 0 .37")
        engine = engine_of(cloth, timestep=timestep, more=ball)
        data = engine.make_data()
        before = engine.energy(data)
        engine.step(data, nstep=round(0.25 / timestep))
        after = engine.energy(data)
        assert after.dissipated > 0.02
        errors.append(abs(after.total - before.total))
    # Of first order in the step, of about 0.1 J that cloth and ball exchange.
    assert errors[0] < 4e-3
    assert errors[1] < 1e-3


def test_disabled_springs_store_nothing():
    engine = engine_of(flex("soft", SHEET, ELASTIC.format("both")))
    engine.model.opt.gravity[:] = 0.0
    data = engine.make_data()
    data.qpos[:] += np.random.default_rng(0).normal(size=engine.model.nq) * 5e-3
    assert engine.energy(data).potential > 1e-3
    engine.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_SPRING)
    assert engine.energy(data).potential == 0.0
