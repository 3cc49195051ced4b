"""What a benchmark scene is, engine independent, and the MJCF pieces that scenes are made of.

A scene is an MJCF string, an initial state, contact materials, what drives it, and a function
that turns the recorded motion into named numbers. Each number has a target; the number is an
error or a bound, so smaller is better. Stepping lives in `simulate`.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot import Material

GRAVITY = 9.81
Array = NDArray[np.float64]
Change = Callable[[mujoco.MjModel, mujoco.MjData], None]


@dataclass(frozen=True)
class Run:
    """Recorded motion: `time` (T,), `qpos` (T, nq), `qvel` (T, nv), one row per sample.

    `penetration` (T, 3) holds the sum of squares (m^2), the sum (m) and the largest (m) of the
    geometric overlaps, `touching` (T,) how many contacts overlap; both are empty unless the scene
    asks for them. `diverged`: MuJoCo found a bad state and reset it. `cpu`: processor time (s) of
    all steps together.
    """

    model: mujoco.MjModel
    time: Array
    qpos: Array
    qvel: Array
    penetration: Array
    touching: Array
    diverged: bool = False
    cpu: float = 0.0

    def position(self, body: str) -> Array:
        """Positions (T, 3) of a free body."""
        start = self.model.jnt_qposadr[self.model.body(body).jntadr[0]]
        return self.qpos[:, start : start + 3]

    def velocity(self, body: str) -> Array:
        """Linear velocities (T, 3) of a free body."""
        start = self.model.jnt_dofadr[self.model.body(body).jntadr[0]]
        return self.qvel[:, start : start + 3]

    def at(self, time: float) -> int:
        """Index of the sample nearest to `time` (s)."""
        return int(np.argmin(np.abs(self.time - time)))


@dataclass(frozen=True, kw_only=True)
class Scene:
    """One benchmark scene; see the module docstring.

    `compiled` stands in place of `xml` where a model comes from files. `direct_solref`, of all
    geoms or a row for each, is the scene's stiffness and damping in MuJoCo's terms, per mass.
    """

    name: str
    title: str
    duration: float
    xml: str = ""
    compiled: mujoco.MjModel | None = None
    measure: Callable[[Run], dict[str, float]]
    targets: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    start: Change | None = None
    drive: Change | None = None
    kick: Change | None = None
    kick_time: float = 0.0
    materials: Mapping[str, Material] = field(default_factory=dict)
    pair_materials: Mapping[tuple[str, str], Material] = field(default_factory=dict)
    direct_solref: Array | tuple[float, float] | None = None
    sample_interval: float | None = None
    penetration: bool = False
    timesteps: tuple[float, ...] = (0.001, 0.002, 0.005, 0.010)

    def model(self, timestep: float) -> mujoco.MjModel:
        """Compile the MJCF, or copy the compiled model, and set the time step (s)."""
        if self.compiled is not None:
            model = copy.copy(self.compiled)
        else:
            model = mujoco.MjModel.from_xml_string(self.xml)
        model.opt.timestep = timestep
        return model


def mjcf(bodies: str, *, option: str = "", rest: str = "", floor: str = "") -> str:
    """Wrap bodies in a world with a plane floor; `floor` overrides its attributes."""
    floor = floor or 'friction="1 0.005 0.0001"'
    return f"""<mujoco>
  <option gravity="0 0 -{GRAVITY}" {option}/>
  <size memory="200M"/>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1" {floor}/>
    {bodies}
  </worldbody>
  {rest}
</mujoco>"""


def free_body(
    name: str, geom: str, position: Array | tuple[float, ...], *, quat: Array | None = None
) -> str:
    """Return a body with a free joint and one geom of the same name (`geom`: its attributes)."""
    pos = " ".join(repr(float(x)) for x in position)
    turn = "" if quat is None else 'quat="' + " ".join(repr(float(x)) for x in quat) + '"'
    return f"""<body name="{name}" pos="{pos}" {turn}>
      <freejoint name="{name}"/><geom name="{name}" {geom}/></body>"""


def set_velocity(body: str, velocity: tuple[float, ...]) -> Change:
    """Return a change that sets the linear velocity (3,) or linear and angular velocity (6,)."""

    def change(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        dof = model.jnt_dofadr[model.body(body).jntadr[0]]
        data.qvel[dof : dof + len(velocity)] = velocity

    return change
