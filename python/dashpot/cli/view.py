"""``dashpot view``: MuJoCo's viewer with dashpot stepping."""

from __future__ import annotations

import argparse
import os
import sys
from typing import Any

from dashpot.cli.options import add_material, add_scene, add_threads, load_engine, positive


def add_to(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "view",
        help="watch a scene in MuJoCo's viewer, stepped by dashpot",
        description="Open MuJoCo's viewer on a scene that dashpot steps in real time. Needs a "
        "display; bodies can be pushed with the mouse. Closing the window ends the command.",
    )
    add_scene(parser)
    parser.add_argument("--timestep", type=positive, metavar="S", help="default: the scene's")
    parser.add_argument(
        "--duration", type=positive, metavar="S", help="close the window after these seconds"
    )
    add_material(parser)
    add_threads(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    engine = load_engine(arguments.scene, arguments.material, arguments.threads)
    if arguments.timestep is not None:
        engine.model.opt.timestep = arguments.timestep
    require_display()
    _watch(engine, arguments.duration)
    return 0


def require_display() -> None:
    """Raise RuntimeError where no window can be opened."""
    remedy = "`dashpot simulate` stores states without one"
    if sys.platform.startswith("linux") and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        raise RuntimeError(f"no display: neither DISPLAY nor WAYLAND_DISPLAY is set; {remedy}")
    import warnings

    import glfw

    with warnings.catch_warnings():
        # GLFW's binding warns of what the next line turns into an error.
        warnings.simplefilter("ignore")
        opened = glfw.init()
    if not opened:
        raise RuntimeError(f"the display cannot be opened; {remedy}")


def _watch(engine: Any, duration: float | None) -> None:
    import time

    import mujoco.viewer

    from dashpot.compare.runner import start

    data = start(engine.model)
    with mujoco.viewer.launch_passive(engine.model, data) as viewer:
        begin = time.perf_counter()
        while viewer.is_running():
            elapsed = time.perf_counter() - begin
            if duration is not None and elapsed >= duration:
                return
            with viewer.lock():
                # Catch up with the clock, but never fall behind by more than a frame.
                for _ in range(max(1, round(1 / 60 / engine.model.opt.timestep))):
                    if data.time >= elapsed:
                        break
                    engine.step(data)
                else:
                    begin = time.perf_counter() - data.time
            viewer.sync()
            time.sleep(1 / 120)
