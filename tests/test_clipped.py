"""`StepStats.clipped` counts what is lowered, and nothing else."""

import mujoco
import pytest

import dashpot

RESTING = """<mujoco><option timestep="0.002"/><worldbody><geom type="plane" size="0 0 1"/>
  <body pos="0 0 0.0999"><freejoint/><geom name="ball" size="0.1" mass="1"/></body>
  </worldbody></mujoco>"""


# With the apparent mass m of the contact, 64 micro-steps of 31 us resolve k up to about m / h^2:
# 1e9 N/m of a normal, some 3e8 N/m of friction on a sphere.
@pytest.mark.parametrize(
    ("stiffness", "tangential_ratio", "rows"),
    [(1e4, 1.0, 0), (1e4, 1e4, 0), (1e4, 1e6, 3), (1e11, 1.0, 3)],
)
def test_stiffness_of_normals_and_of_friction_that_is_lowered_counts(
    stiffness, tangential_ratio, rows
):
    engine = dashpot.Engine(mujoco.MjModel.from_xml_string(RESTING))
    engine.set_material("ball", dashpot.Material(stiffness, tangential_ratio=tangential_ratio))
    assert engine.step(engine.make_data()).clipped == rows


def test_restitution_to_which_rigid_stiffness_gives_way_counts_in_no_step():
    boxes = "".join(
        f'<body pos="0 0 {0.15 + 0.21 * i}"><freejoint/>'
        f'<geom name="{i}" type="box" size="0.1 0.1 0.1" mass="1"/></body>'
        for i in range(3)
    )
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><option timestep="0.002"/><worldbody><geom type="plane" size="0 0 1"/>'
        f"{boxes}</worldbody></mujoco>"
    )
    engine = dashpot.Engine(model)
    for i in range(3):
        engine.set_material(str(i), dashpot.Material(restitution=0.1))
    data = engine.make_data()
    assert max(engine.step(data).clipped for _ in range(1000)) == 0
