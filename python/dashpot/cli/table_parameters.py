"""What ``--fit`` says is unknown, as parameters of a problem."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from dashpot.cli.pictures import parameter_of

if TYPE_CHECKING:
    import mujoco

    from dashpot.calibrate import ImagePlane, Parameter
    from dashpot.engine import Engine

_OF_RECORDERS = ("delay", "gain", "offset", "scale")
FIT_HELP = (
    "what is unknown, as pair:GEOM,GEOM:QUANTITY,... (four geoms: two pairs, and so on) or "
    "material:GEOM:QUANTITY,... or "
    "model:ARRAY:ELEMENT or, of a picture, image:QUANTITY,... with scale, tilt, origin_u, "
    "origin_v, or, of a recorder, delay:SENSOR=LOWER..UPPER, gain:..., offset:..., "
    "scale:poses=...; a quantity may say where it starts, stiffness=1e4, or its bounds, "
    "stiffness=1e3..1e6; may be given several times"
)


def parameters_of(
    specs: Sequence[str], engine: Engine, camera: str | ImagePlane | None
) -> list[Parameter]:
    """Return the parameters of ``--fit``; raise ValueError naming what is wrong."""
    from dashpot.calibrate import Parameter

    made: list[Parameter] = []
    for spec in specs:
        kind, _, rest = spec.partition(":")
        target, _, quantities = rest.rpartition(":")
        picture = kind == "image" and not target
        recorder = kind in _OF_RECORDERS and not target
        known = picture or recorder or (kind in ("pair", "material", "model") and target)
        if not known or not quantities:
            raise ValueError(f"--fit {spec!r} is not {FIT_HELP.split('; ')[0][20:]}")
        elements = [_element(name, engine) for name in target.split(",")]
        for quantity in quantities.split(","):
            name, _, text = quantity.partition("=")
            options = _range(f"--fit {name}", text)
            try:
                if picture:
                    made.append(parameter_of(name, camera, options, engine.model))
                    continue
                if recorder:
                    made.append(_of_recorder(kind, name, options))
                    continue
                if kind == "model":
                    made.append(_of_model(target, name, options, engine.model))
                    continue
                taken = [p.name for p in made]
                options["name"] = f"{name} {target}" if name in taken else name
                if kind == "material":
                    made.append(Parameter.material(elements, name, **options))  # type: ignore[arg-type]
                elif len(elements) % 2:
                    raise ValueError(f"a pair has two geoms, not {len(elements)}")
                else:
                    pairs = list(zip(elements[::2], elements[1::2], strict=True))
                    made.append(Parameter.pair(pairs, name, **options))  # type: ignore[call-overload]
            except (ValueError, TypeError) as error:
                raise ValueError(f"--fit {spec!r}: {error}") from None
    return made


def _of_recorder(kind: str, channel: str, options: dict[str, Any]) -> Parameter:
    """Return a delay, a gain or an offset of a channel, or the scale of positions."""
    from dashpot.calibrate import Parameter

    if "bounds" not in options:
        raise ValueError(f"it needs bounds, as {kind}:{channel}=LOWER..UPPER")
    lower, upper = options["bounds"]
    if not lower < (1.0 if kind in ("gain", "scale") else 0.0) < upper:
        options["start"] = 0.5 * (lower + upper)
    if kind != "scale":
        made: Parameter = getattr(Parameter, kind)(channel, **options)
        return made
    if channel != "poses":
        raise ValueError(f"scale is of 'poses', not {channel!r}")
    return Parameter.scale(**options)


def _of_model(
    target: str, element: str, options: dict[str, Any], model: mujoco.MjModel
) -> Parameter:
    """Return a parameter of an array, ``NAME`` or ``NAME[COLUMN]``, between a tenth and tenfold."""
    from dashpot.calibrate import Parameter
    from dashpot.calibrate.problem.default_ranges import middle

    match = re.fullmatch(r"(\w+)(?:\[(\d+)\])?", target)
    if match is None:
        raise ValueError(f"{target!r} is not ARRAY or ARRAY[COLUMN]")
    index = None if match[2] is None else int(match[2])
    if "bounds" not in options:
        now = options.get("start")
        if now is None and match[1].startswith("body_mass"):
            now = float(model.body(element).mass[0])
        if now is None or now <= 0.0:
            raise ValueError(f"{target} has no default bounds: say {element}=LOWER..UPPER")
        options |= {"start": now, "bounds": (now / 10.0, now * 10.0)}
    linear = options["bounds"][0] <= 0.0
    options.setdefault("start", middle(options["bounds"], logarithmic=not linear))
    return Parameter.model(
        match[1], element, index=index, transform="linear" if linear else "log", **options
    )


def _range(label: str, text: str) -> dict[str, Any]:
    """Return what ``START`` or ``LOWER..UPPER`` says."""
    lower, dots, upper = text.partition("..")
    if dots:
        return {"bounds": (float_of(label, lower), float_of(label, upper))}
    return {"start": float_of(label, text)} if text else {}


def _element(name: str, engine: Engine) -> str | int:
    """Return a geom by name, or by id where none has such a name."""
    named = any(engine.model.geom(i).name == name for i in range(engine.model.ngeom))
    return int(name) if name.isdecimal() and not named else name


def float_of(label: str, text: str) -> float:
    """Return a number; raise ValueError beginning with `label`."""
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{label}: {text!r} is not a number") from None
