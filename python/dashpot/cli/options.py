"""Options that several commands share, and what they mean."""

from __future__ import annotations

import argparse
import difflib
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.progress import Progress

    from dashpot.engine import Engine
    from dashpot.materials import Material

MATERIAL_HELP = (
    "material of a geom by name or id, or of all with the name '*', as "
    "GEOM:field=value,... with the fields of dashpot.Material, for example "
    "ball:stiffness=1e5,restitution=0.8,friction=0.5 or friction=0.5/0.005/0.0001 (sliding, "
    "torsional, rolling; of two geoms the larger counts); may be given several times"
)


def positive(text: str) -> float:
    """Return a finite number > 0, or raise what argparse reports."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not (math.isfinite(number) and number > 0):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number > 0")
    return number


def new_file(text: str) -> Path:
    """Return where a file can be written, or raise what argparse reports."""
    file = Path(text)
    if file.is_dir():
        raise argparse.ArgumentTypeError(f"{text!r} is a folder, not a file")
    if not file.parent.is_dir():
        raise argparse.ArgumentTypeError(f"the folder {str(file.parent)!r} does not exist")
    return file


def new_archive(text: str) -> Path:
    """Return where an .npz file can be written, or raise what argparse reports."""
    return _new_file_of(text, ".npz")


def new_table(text: str) -> Path:
    """Return where a .csv file can be written, or raise what argparse reports."""
    return _new_file_of(text, ".csv")


def _new_file_of(text: str, suffix: str) -> Path:
    file = new_file(text)
    if file.suffix.lower() != suffix:
        raise argparse.ArgumentTypeError(f"{text!r} does not end in {suffix}")
    return file


def new_report(text: str) -> Path:
    """Return where a report can be written, or raise what argparse reports."""
    import importlib.util

    if importlib.util.find_spec("jinja2") is None:
        raise argparse.ArgumentTypeError(
            "reports need the package jinja2: pip install 'dashpot[report]'"
        )
    return new_file(text)


def new_picture(text: str) -> Path:
    """Return where a picture can be written, or raise what argparse reports."""
    from matplotlib.figure import Figure

    file = new_file(text)
    known = sorted(Figure().canvas.get_supported_filetypes())
    if file.suffix.removeprefix(".").lower() not in known:
        raise argparse.ArgumentTypeError(f"{text!r} ends in none of {', '.join(known)}")
    return file


def folder(text: str) -> Path:
    """Return a folder that is there or can be made, or raise what argparse reports."""
    path = Path(text)
    existing = next(p for p in (path, *path.absolute().parents) if p.exists())
    if not existing.is_dir():
        raise argparse.ArgumentTypeError(f"{str(existing)!r} is a file, not a folder")
    return path


def count(text: str) -> int:
    """Return a whole number >= 1, or raise what argparse reports."""
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number >= 1")
    return int(text)


def seed(text: str) -> int:
    """Return a whole number >= 0, or raise what argparse reports."""
    if not text.isdigit():
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number >= 0")
    return int(text)


def material(text: str) -> tuple[str, Material]:
    """Return (geom, material) of ``GEOM:field=value,...``, or raise what argparse reports."""
    from dashpot.materials import Material

    geom, separator, rest = text.rpartition(":")
    known = [f.name for f in fields(Material) if f.init]
    values: dict[str, Any] = {}
    if not separator or not geom:
        raise argparse.ArgumentTypeError(f"{text!r} is not GEOM:field=value,...")
    for part in rest.split(","):
        name, equals, value = (piece.strip() for piece in part.partition("="))
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise argparse.ArgumentTypeError(f"{name!r} is none of {', '.join(known)}{hint}")
        if not equals or name in values:
            raise argparse.ArgumentTypeError(f"{text!r} gives {name} twice or without '='")
        try:
            numbers = tuple(float(number) for number in value.split("/"))
        except ValueError:
            raise argparse.ArgumentTypeError(f"{name} is {value!r}, not a number") from None
        values[name] = numbers if len(numbers) > 1 else numbers[0]
    try:
        return geom, Material(**values)
    except (ValueError, TypeError) as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def add_scene(parser: argparse.ArgumentParser) -> None:
    """Add the scene that `load_engine` takes."""
    parser.add_argument(
        "scene", help="MJCF, URDF or MJB file, or a shipped scene: ball, slope, stack, pile"
    )


def add_threads(parser: argparse.ArgumentParser) -> None:
    """Add ``--threads``."""
    parser.add_argument(
        "--threads",
        type=count,
        default=1,
        metavar="N",
        help="threads that share a step of dashpot's (%(default)s); results are the same",
    )


def add_material(parser: argparse.ArgumentParser) -> None:
    """Add ``--material``."""
    parser.add_argument(
        "--material", type=material, action="append", default=[], metavar="SPEC", help=MATERIAL_HELP
    )


def apply_materials(engine: Engine, given: list[tuple[str, Material]]) -> None:
    """Give an engine the materials of ``--material``, in their order."""
    materials: dict[int, Material] = {}
    for geom, value in given:
        targets: list[str | int] = [geom]
        if geom == "*":
            targets = list(range(engine.model.ngeom))
        elif geom.isdigit() and geom not in geom_names(engine):
            targets = [int(geom)]
        materials.update({engine.geom_id(target): value for target in targets})
    engine.set_materials(materials)


def geom_names(engine: Engine) -> set[str]:
    """Return the names of all geoms that have one."""
    return {engine.model.geom(index).name for index in range(engine.model.ngeom)} - {""}


def load_engine(scene: str, given: list[tuple[str, Material]], nthread: int) -> Engine:
    """Return an engine of a scene file or shipped scene, with the materials of ``--material``."""
    from dashpot.compare import SCENES
    from dashpot.engine import Engine

    if scene in SCENES:
        shipped = SCENES[scene]()
        engine = Engine(shipped.xml, nthread=nthread)
        engine.set_materials(shipped.materials)
    else:
        try:
            engine = Engine(Path(scene), nthread=nthread)
        except FileNotFoundError as error:
            raise FileNotFoundError(f"{error}; shipped scenes are {', '.join(SCENES)}") from None
    apply_materials(engine, given)
    return engine


@contextmanager
def progress_bar(description: str, total: float) -> Iterator[tuple[Progress, Any]]:
    """Show a bar on standard error while the block runs, where that is a terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as progress:
        yield progress, progress.add_task(description, total=total)
