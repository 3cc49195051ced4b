"""The report of a plan: one HTML file that needs nothing from outside."""

from __future__ import annotations

import os
from pathlib import Path as File
from typing import TYPE_CHECKING

from dashpot.grinding.plots import plot_along, plot_checks, plot_depth, plot_joints
from dashpot.rendering import embedded, need_templates, write_page
from dashpot.versions import model_hash, now, versions

if TYPE_CHECKING:
    from dashpot.grinding.checks import Checks
    from dashpot.grinding.plan import Plan

__all__ = ["write_report"]

_MM, _UM = 1e3, 1e6


def write_report(plan: Plan, file: str | os.PathLike[str], checks: Checks | None = None) -> File:
    """Write what `Plan.report` does."""
    need_templates()
    figures = [
        (plot_depth(plan), "Depth removed over the part."),
        (
            plot_along(plan),
            "Normal force and feed along the way, run-in and run-out included, and the depth that "
            "is left; grey lines are the largest deviation that was allowed.",
        ),
        (plot_joints(plan), "Angles and speeds of the joints, as the simulated arm moved."),
    ]
    header: tuple[str, ...] = ()
    rows: list[tuple[str, ...]] = []
    if checks is not None:
        header, rows = checks.cells()
        figures.append(
            (
                plot_checks(plan, checks),
                "Depth along the way of the same set points, where something differs.",
            )
        )
    target = plan.target
    asked = [
        ("depth", f"{_UM * target.depth:g} um in {len(plan.passes)} pass(es)"),
        ("Preston's coefficient", f"{target.preston:g} 1/Pa"),
        ("largest force", f"{target.max_force:g} N; it was {plan.peak_force:.3g} N"),
        ("feed", f"{target.feed[0]:g} to {target.feed[1]:g} m/s"),
        (
            "evenness",
            f"standard deviation {100 * target.uniformity:g} %, largest {100 * target.largest:g} "
            f"%; it was {100 * plan.uniformity:.2f} % and {100 * plan.largest:.2f} %",
        ),
        ("time", f"{plan.duration:.3f} s"),
    ]
    cell = plan.cell
    made = [
        ("arm", os.path.basename(os.fspath(cell.arm.file))),
        ("tool", repr(cell.tool)),
        ("workpiece", cell.part.kind),
        (
            "contact",
            f"{cell.stiffness:g} N/m, {cell.damping:g} N s/m, friction {cell.friction:g}",
        ),
        ("control", f"{cell.control.kind}, {cell.control.rate:g} set points a second"),
        ("time step", f"{_MM * cell.timestep:g} ms, {cell.integrator}"),
        ("search", f"{plan.rollouts} passes simulated in {plan.seconds:.1f} s"),
        ("model", f"SHA-256 {model_hash(cell.parts.model)}"),
        ("date", now()),
        ("versions", ", ".join(f"{name} {version}" for name, version in versions().items())),
    ]
    values = {
        "title": f"Grinding {_UM * target.depth:g} um along {_MM * plan.path.length:.0f} mm",
        "summary": f"{len(plan.passes)} pass(es) of an arm, planned on the force of contact: "
        f"{'as even as was asked for' if plan.met else 'not as even as was asked for'}.",
        "asked": asked,
        "figures": [(embedded(figure), caption) for figure, caption in figures],
        "header": header,
        "rows": rows,
        "made": made,
        "version": versions()["dashpot"],
    }
    return write_page(file, "dashpot.grinding", "grinding.html.j2", values)
