"""Passes of a tool that an arm leads over a workpiece, planned on the force of contact.

An arm grinds or polishes evenly where it keeps the force of contact as a plan says. `Cell` is the
arm, its tool, the workpiece and the contact in N/m and N s/m. `Path` is a curve on the part with
the joint angles that reach it. `plan` chooses feed and force along it, so that Preston's law takes
off a depth evenly, in the least time. `press_trial` finds stiffness and damping from a recorded
press. `docs/grinding.md` has the method and its limits.

    from dashpot import grinding
    cell = grinding.Cell.ur5e(tool=grinding.BallNose(0.02), work="part.xml", stiffness=2e4)
    path = grinding.Path.on_surface(cell, curve, spacing=0.005)
    plan = grinding.plan(cell, path, depth=50e-6, preston=1e-7, max_force=90)
    plan.check(timestep=2.5e-4); plan.save("pass.csv"); plan.report("pass.html")

The UR5e and inverse kinematics need the extra ``dashpot[grinding]``.
"""

from dashpot.grinding.cell import Arm, Cell
from dashpot.grinding.checks import Check, Checks
from dashpot.grinding.control import Control
from dashpot.grinding.curves import line, raster
from dashpot.grinding.passes import PlannedPass
from dashpot.grinding.path import Path
from dashpot.grinding.plan import Plan, plan
from dashpot.grinding.press import PressLog, record_press
from dashpot.grinding.removal import DepthMap, depth_along, removed_volume
from dashpot.grinding.simulation import Pass
from dashpot.grinding.spindle import Imbalance, Spindle
from dashpot.grinding.tools import BallNose, Disc, OwnTool, Tool
from dashpot.grinding.trial import PressFit, press_trial
from dashpot.grinding.work import Work

__all__ = [
    "Arm",
    "BallNose",
    "Cell",
    "Check",
    "Checks",
    "Control",
    "DepthMap",
    "Disc",
    "Imbalance",
    "OwnTool",
    "Pass",
    "Path",
    "Plan",
    "PlannedPass",
    "PressFit",
    "PressLog",
    "Spindle",
    "Tool",
    "Work",
    "depth_along",
    "line",
    "plan",
    "press_trial",
    "raster",
    "record_press",
    "removed_volume",
]
