"""Calibration of a table by options alone: what its columns hold, and what is to be fitted."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from dashpot.cli import pictures
from dashpot.cli.options import add_material, count, load_engine, positive
from dashpot.cli.pictures import camera_of
from dashpot.cli.table_parameters import FIT_HELP, float_of, parameters_of

if TYPE_CHECKING:
    import mujoco

    from dashpot.calibrate import Problem, Trajectory

_ESTIMATE = "estimate"


def add_to(parser: argparse.ArgumentParser) -> None:
    """Add the options that make a problem of a table."""
    options = parser.add_argument_group("of a table (.csv)")
    options.add_argument("--model", metavar="FILE", help="MJCF, URDF or MJB file")
    options.add_argument(
        "--columns",
        type=_assignments,
        action="append",
        metavar="KEY=COLUMN,...",
        help="columns by what they hold: time, x, y, z, qw, qx, qy, qz, u and v in pixels, "
        "sensor:NAME, run (default: columns are named so). run tells several runs apart",
    )
    pictures.add_to(options)
    options.add_argument("--fit", action="append", metavar="SPEC", help=FIT_HELP)
    options.add_argument("--body", metavar="NAME", help="(default: the one that moves freely)")
    options.add_argument(
        "--unit",
        type=_assignments,
        action="append",
        metavar="KEY=UNIT,...",
        help="such as time=ms,z=cm, or factors to SI's: z=-0.01",
    )
    options.add_argument(
        "--frames",
        choices=("stamped", "even"),
        help="whether times are right as stamped (default), or frames even and their stamps jitter",
    )
    options.add_argument(
        "--rate", type=positive, metavar="HZ", help="frames a second, where they are even"
    )
    options.add_argument(
        "--window", type=_window, metavar="START..END", help="seconds of the recording that count"
    )
    options.add_argument(
        "--noise",
        type=_deviations,
        action="append",
        metavar="KEY=SIGMA,...",
        help="standard deviations: position (m), rotation (rad), pixels, sensors by name (default: "
        "how far readings are from smooth paths). The word 'estimate': those of each channel "
        "start there, and are estimated from the residuals",
    )
    options.add_argument(
        "--starts", type=count, metavar="N", help="further starts, spread over the bounds"
    )
    options.add_argument(
        "--windows",
        type=_seconds,
        metavar="SECONDS,...",
        help="first seconds of the recording to fit before all of it, in ascending order",
    )
    options.add_argument(
        "--max-evaluations", type=count, metavar="N", help="budget of the fit, in simulations"
    )
    options.add_argument(
        "--held-out", metavar="FILE", help="another such table, which is predicted, not fitted"
    )
    options.add_argument(
        "--head", type=positive, metavar="SECONDS", help="of each run in it that tell how it starts"
    )
    add_material(parser)


def read_table_problem(arguments: argparse.Namespace) -> tuple[Problem, dict[str, Any]]:
    """Return the problem that options state of a table, and options for the fit.

    Raises
    ------
    ValueError
        Naming the option or file at fault.
    """
    from dashpot.calibrate import Problem
    from dashpot.calibrate.problem.data_warnings import strange_falls

    for option in ("model", "fit"):
        if getattr(arguments, option) is None:
            raise ValueError(f"a table needs --{option}; see dashpot calibrate --help")
    engine = load_engine(arguments.model, arguments.material, 1)
    trajectories = _trajectories(arguments, engine.model, arguments.problem)
    stated = _joined(arguments.noise)
    estimated = stated.pop(_ESTIMATE, None) is not None
    position, rotation, sensors = _noise(stated, trajectories)
    if arguments.window is not None:
        trajectories = [trajectory.between(*arguments.window) for trajectory in trajectories]
    problem = Problem(
        engine,
        parameters_of(arguments.fit, engine, camera_of(arguments)),
        trajectories,
        position,
        rotation,
        initial_state="pose_and_velocity",
        sensor_sigma=sensors,
        noise="estimate" if estimated else "stated",
    )
    # Who gave units is told by the fit itself.
    for name, what in () if arguments.unit else strange_falls(problem).items():
        raise ValueError(
            f"{arguments.problem}: trajectory '{name}': {what}; say what units are: --unit "
            "time=ms,z=cm or such"
        )
    chosen = {name: getattr(arguments, name) for name in ("starts", "windows", "max_evaluations")}
    return problem, {name: value for name, value in chosen.items() if value is not None}


def read_held_out(arguments: argparse.Namespace, problem: Problem) -> list[Trajectory]:
    """Return the runs that are to be predicted, none where the options name no file.

    Raises
    ------
    ValueError
        Where one of --held-out and --head is given without the other.
    """
    if (arguments.held_out is None) != (arguments.head is None):
        raise ValueError(
            "--held-out needs --head, the seconds before the first contact, or at least some, from "
            "which the start of each run is estimated; and the other way round"
        )
    if arguments.held_out is None:
        return []
    from dashpot.calibrate.problem.setters import model_of

    model = model_of(problem.build(problem.start))
    return _trajectories(arguments, model, arguments.held_out)


def refuse_options(arguments: argparse.Namespace) -> None:
    """Raise ValueError where options of tables are given beside a problem file."""
    names = (
        "model",
        "columns",
        "camera",
        "image",
        "fit",
        "body",
        "unit",
        "frames",
        "rate",
        "window",
        "noise",
        "starts",
        "windows",
        "max_evaluations",
        "material",
        "held_out",
        "head",
    )
    given = next((name for name in names if getattr(arguments, name)), None)
    if given is not None:
        raise ValueError(
            f"--{given.replace('_', '-')} is for tables, .csv; {arguments.problem} says it itself"
        )


def described(problem: Problem) -> list[str]:
    """Return lines that say what was assumed: starts, bounds and noise."""
    lines = [
        f"{p.name}: from {p.start:.4g}, between {p.bounds[0]:.4g} and {p.bounds[1]:.4g}"
        for p in problem.unknowns
    ]
    lines += [f"{name}: held at {value:.6g}" for name, value in problem.held.items()]
    noise = [f"{problem.position_sigma:.3g} m", f"{problem.rotation_sigma:.3g} rad"]
    noise = [text for text in noise if not text.startswith("inf")]
    noise += [f"{name} {sigma[0]:.3g}" for name, sigma in problem.sensor_sigma.items()]  # type: ignore[index]
    count = len(problem.trajectories)
    frames = sum(trajectory.frames for trajectory in problem.trajectories)
    kind = "noise of" if problem.noise == "stated" else "noise to be estimated, from"
    return [*lines, f"{count} runs of {frames} frames, {kind} {', '.join(noise)}"]


def _trajectories(
    arguments: argparse.Namespace, model: mujoco.MjModel, file: str
) -> list[Trajectory]:
    from dashpot.calibrate import Trajectory

    columns = _joined(arguments.columns) or None
    run = None if columns is None else columns.pop("run", None)
    fields = {
        name: getattr(arguments, name) for name in ("frames", "rate") if getattr(arguments, name)
    }
    poses = columns is None or not all(key.startswith(("time", "sensor")) for key in columns)
    body = (arguments.body or _moving_body(model)) if poses else ()
    unit = {key: _factor(text) for key, text in _joined(arguments.unit).items()}
    read = {"columns": columns, "body": body, "unit": unit, **fields}
    camera = camera_of(arguments)
    if camera is not None:
        read["camera"] = camera
    if run is None:
        return [Trajectory.from_csv(file, **read)]
    return Trajectory.from_csv(file, run=run, **read)


def _seconds(text: str) -> list[float]:
    return [positive(part) for part in text.split(",")]


def _moving_body(model: mujoco.MjModel) -> str:
    """Return the only body on a free joint, or the only one on any."""
    import mujoco

    free = model.jnt_bodyid[model.jnt_type == mujoco.mjtJoint.mjJNT_FREE]
    for candidates in (free, model.jnt_bodyid):
        names = {model.body(int(body)).name for body in candidates}
        if len(names) == 1:
            return str(names.pop())
    raise ValueError(f"--body must say which body was observed: {', '.join(sorted(names))}")


def _noise(
    given: dict[str, str], trajectories: Sequence[Trajectory]
) -> tuple[float, float, dict[str, float]]:
    from dashpot.calibrate.data.smoothness import position_noise, rotation_noise, sensor_noise

    noise = {
        "position": position_noise(trajectories),
        "rotation": rotation_noise(trajectories),
        **sensor_noise(trajectories),
    }
    points = {name for trajectory in trajectories for name in trajectory.views}
    for key, text in given.items():
        if key not in noise and not (points and key == "pixels"):
            raise ValueError(
                f"--noise: {key!r} is none of {', '.join([*noise, *['pixels'] * bool(points)])}"
            )
        for name in points if key == "pixels" else (key,):
            noise[name] = float_of(f"--noise {key}", text)
    return noise.pop("position"), noise.pop("rotation"), noise


def _factor(text: str) -> str | float:
    try:
        return float(text)
    except ValueError:
        return text


def _joined(parts: Sequence[dict[str, str]] | None) -> dict[str, str]:
    return {key: value for part in parts or () for key, value in part.items()}


def _assignments(text: str) -> dict[str, str]:
    """Return ``KEY=VALUE,...`` as a mapping, or raise what argparse reports."""
    result = {}
    for part in text.split(","):
        key, equals, value = (piece.strip() for piece in part.partition("="))
        if not (key and equals and value) or key in result:
            raise argparse.ArgumentTypeError(f"{text!r} is not KEY=VALUE,... with different keys")
        result[key] = value
    return result


def _deviations(text: str) -> dict[str, str]:
    """Return ``KEY=SIGMA,...`` as a mapping, with the word ``estimate`` where it is given."""
    words = text.split(",")
    rest = ",".join(word for word in words if word.strip() != _ESTIMATE)
    found = {_ESTIMATE: ""} if _ESTIMATE in map(str.strip, words) else {}
    return found | (_assignments(rest) if rest else {})


def _window(text: str) -> tuple[float, float]:
    """Return ``START..END`` in s, or raise what argparse reports."""
    first, dots, last = text.partition("..")
    try:
        start, end = float(first), float(last)
    except ValueError:
        start = end = 0.0
    if not dots or not start < end:
        raise argparse.ArgumentTypeError(f"{text!r} is not START..END in seconds")
    return start, end
