"""Damaged recordings: mutated files of every kind that dashpot reads, and what their readers say.

    python benchmarks/mutated_files.py -n 100000     # an hour and a half of one core
    python benchmarks/mutated_files.py -n 10000 --kinds .csv .toml checkpoint

Bytes are changed, left out, repeated and cut off; half of the time numbers of a header are changed.
A reader returns or raises ValueError, in a process whose address space may grow by as much as
`ROOM`. Anything else is printed with its seed, and counts as a failure.
"""

from __future__ import annotations

import argparse
import collections
import json
import re
import resource
import signal
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np

from dashpot.calibrate import Fit, ImagePlane, Parameter, Problem, Trajectory, fit
from dashpot.calibrate.residuals.checkpoint import Checkpoint
from dashpot.cli import parser, table_problem
from dashpot.cli.problem_file import read_problem
from dashpot.cli.recordings import read_npz
from dashpot.data import load_cube_tosses, save_cube_tosses
from dashpot.data.cube_tosses import CubeTosses, make_toss
from dashpot.data.torch_file import read_tensor

ROOM = 600 << 20  # bytes; MAX_BYTES of an archive, twice, and what a reader needs besides
MODEL = """<mujoco><worldbody><geom type="plane" size="1 1 1"/>
  <body name="ball" pos="0 0 1"><freejoint/><geom name="ball" size=".1"/><site name="s"/></body>
  </worldbody><sensor><accelerometer name="imu" site="s"/></sensor></mujoco>"""
FRAMES = 40
LONGEST = 20  # s for one file
PICKLE = (  # of a tensor of (4, 5) doubles, as PyTorch writes it
    b"\x80\x02ctorch._utils\n_rebuild_tensor_v2\nq\x00((X\x07\x00\x00\x00storageq\x01ctorch\n"
    b"DoubleStorage\nq\x02X\x01\x00\x00\x000q\x03X\x03\x00\x00\x00cpuq\x04K\x14tq\x05QK\x00K\x04K\x05"
    b"\x86q\x06K\x05K\x01\x86q\x07\x89ccollections\nOrderedDict\nq\x08)Rq\ttq\nRq\x0b."
)
COLUMNS = {"time": "t", "u": "x_px", "v": "y_px"}
WORDS = ["--columns", "time=t,u=x_px,v=y_px", "--image", "scale=900,origin=9/9"]
WORDS += ["--fit", "image:scale,tilt", "--fit", "material:ball:stiffness", "--noise", "estimate"]
FILM = """model = "scene.xml"
noise = "estimate"
initial_state = "pose_and_velocity"
sensor_sigma = {pixels = 0.5}
[[parameters]]
kind = "image"
quantity = "scale"
bounds = [300.0, 3000.0]
[[trajectories]]
file = "film.csv"
bodies = ["ball"]
columns = {time = "t", u = "x_px", v = "y_px"}
camera = {scale = 900, origin = [60, 90], right = [1, 0, 0]}
frames = "even"
"""
Reader = Callable[[Path], object]


def whole_files(folder: Path) -> dict[str, tuple[Path, Reader]]:
    """Write a whole file of each kind; return it with its reader."""
    import zipfile

    model = mujoco.MjModel.from_xml_string(MODEL)
    time_of_frames = np.arange(FRAMES) / 100
    rng = np.random.default_rng(0)
    position = np.cumsum(rng.normal(size=(FRAMES, 3)), axis=0) * 1e-3
    quaternion = np.tile([1.0, 0.0, 0.0, 0.0], (FRAMES, 1))
    (folder / "scene.xml").write_text(MODEL)
    arrays = {"time": time_of_frames, "position": position, "quaternion": quaternion}
    arrays["initial_qvel"] = np.zeros(6)
    np.savez(folder / "stored.npz", **arrays)
    np.savez_compressed(folder / "packed.npz", **arrays, **{"sensors.imu": position})
    table = np.column_stack([time_of_frames, position, quaternion])
    header = "time,x,y,z,qw,qx,qy,qz"
    np.savetxt(folder / "throw.csv", table, "%.6f", ",", header=header, comments="")
    lines = ["# camera 2", "run;t (ms);height;F", *(
        f"{i // 20 + 1};{1e3 * t:.1f};{100 * x:.3f};{'' if i % 4 else '1,5'}".replace(".", ",")
        for i, (t, x) in enumerate(zip(time_of_frames, position[:, 0], strict=True))
    )]  # fmt: skip
    (folder / "runs.csv").write_text("\n".join(lines))
    pixels = 300.0 + 1e4 * position[:, :2]
    film = np.column_stack([time_of_frames, pixels])
    np.savetxt(folder / "film.csv", film, "%.3f", ",", header="t,x_px,y_px", comments="")
    np.savez(folder / "film.npz", **{"time": time_of_frames, "pixels.ball": pixels})
    save_fit(folder, model, make_fall(time_of_frames, position))
    problem = {
        "model": "scene.xml",
        "position_sigma": 0.001,
        "rotation_sigma": 0.01,
        "materials": {"ball": {"stiffness": 1e4}},
        "parameters": [
            {
                "kind": "material",
                "geoms": ["ball"],
                "quantity": "stiffness",
                "start": 1e4,
                "bounds": [100.0, 1e6],
            }
        ],
        "trajectories": [{"file": "stored.npz", "bodies": ["ball"]}],
    }
    (folder / "problem.json").write_text(json.dumps(problem))
    lines = ['model = "scene.xml"', "position_sigma = 0.001", "rotation_sigma = 0.01"]
    lines += ["[materials.ball]", "stiffness = 1e4", "[[parameters]]", 'kind = "material"']
    lines += ['geoms = ["ball"]', 'quantity = "stiffness"', "start = 1e4", "bounds = [100.0, 1e6]"]
    lines += ["[[trajectories]]", 'file = "stored.npz"', 'bodies = ["ball"]']
    (folder / "problem.toml").write_text("\n".join(lines))
    (folder / "film.toml").write_text(FILM)
    still = [np.zeros((FRAMES, 3))] * 2
    tosses = [make_toss(i, position, quaternion, *still) for i in range(2)]
    save_cube_tosses(CubeTosses(tuple(tosses)), folder / "tosses.npz")
    with zipfile.ZipFile(folder / "tensor.pt", "w") as archive:
        archive.writestr("archive/data.pkl", PICKLE)
        archive.writestr("archive/data/0", np.arange(20.0).tobytes())
    return {
        "stored.npz": (folder / "stored.npz", lambda file: read_npz(file, ["ball"], model)),
        "packed.npz": (folder / "packed.npz", lambda file: read_npz(file, ["ball"], model)),
        "tosses.npz": (folder / "tosses.npz", load_cube_tosses),
        "throw.csv": (folder / "throw.csv", lambda file: Trajectory.from_csv(file, body="ball")),
        "runs.csv": (folder / "runs.csv", read_laboratory_table),
        "film.csv": (folder / "film.csv", read_film),
        "options.csv": (folder / "film.csv", read_by_options),
        "film.npz": (folder / "film.npz", lambda file: read_npz(file, [], model)),
        "fit.json": (folder / "fit.json", Fit.load),
        "checkpoint.npz": (folder / "checkpoint.npz", Checkpoint),
        "film.toml": (folder / "film.toml", read_problem),
        "tensor.pt": (folder / "tensor.pt", read_tensor),
        "problem.json": (folder / "problem.json", read_problem),
        "problem.toml": (folder / "problem.toml", read_problem),
    }


def make_fall(time_of_frames: np.ndarray, position: np.ndarray) -> Trajectory:
    """Return a recording whose start is known."""
    start = [*position[0], 1.0, 0.0, 0.0, 0.0]
    return Trajectory("fall", time_of_frames, position, None, "ball", initial_qpos=start)


def save_fit(folder: Path, model: mujoco.MjModel, fall: Trajectory) -> None:
    """Write a fit, and what it simulated."""
    unknown = Parameter.model("body_mass", "ball", start=1.0, bounds=(0.1, 10.0))
    problem = Problem(model, [unknown], [fall], position_sigma=0.1, initial_state="velocity")
    result = fit(problem, starts=0, max_evaluations=9, checkpoint=folder / "checkpoint.npz")
    result.save(folder / "fit.json")


def read_film(file: Path) -> object:
    """Read pixels of a ball in the picture of a plane; they must be what plain cells say."""
    plane = ImagePlane(scale=900)
    film = Trajectory.from_csv(file, columns=COLUMNS, body="ball", camera=plane)
    said = plain_table(file, tuple(COLUMNS.values()))
    if said is not None and not np.array_equal(film.sensors["image:ball"], said[:, 1:], True):
        raise AssertionError("other numbers than the file has")
    return film


def plain_table(file: Path, names: tuple[str, ...]) -> np.ndarray | None:
    """Return columns of a table whose lines are a header and plain numbers, None of another."""
    try:
        header, *lines = file.read_text("utf-8").split("\n")
        rows = [line.split(",") for line in lines if line.strip()]
        if any(not re.fullmatch(r"-?\d+(\.\d*)?", cell) for row in rows for cell in row):
            return None
        places = [header.split(",").index(name) for name in names]
        return np.array(rows, dtype=np.float64)[:, places]
    except (ValueError, IndexError):
        return None


def read_by_options(file: Path) -> object:
    """Read what the command line reads of a table, up to the fit."""
    return table_problem.read_table_problem(
        parser().parse_args(
            ["calibrate", str(file), "--model", str(file.parent / "scene.xml"), *WORDS]
        )
    )


def read_laboratory_table(file: Path) -> object:
    """Read runs of a ball's height and a load cell, with names and units of a file's own."""
    return Trajectory.from_csv(
        file,
        columns={"time": "t (ms)", "z": "height", "sensor:load": "F"},
        body="ball",
        run="run",
        unit={"time": "ms", "z": "cm"},
        frames="even",
    )


def too_long(number: int, frame: object) -> None:
    """Raise TimeoutError: nothing that is read of a small file takes so long."""
    raise TimeoutError(f"{LONGEST} s")


def mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """Return content with one to four changes."""
    changed = bytearray(content)
    for _ in range(rng.integers(1, 5)):
        if not changed:
            break
        place = int(rng.integers(len(changed)))
        kind = rng.integers(6)
        if kind == 0:
            changed[place] = rng.integers(256)
        elif kind == 1:
            changed[place] ^= 1 << rng.integers(8)
        elif kind == 2:
            del changed[place : place + int(rng.integers(1, 20))]
        elif kind == 3:
            end = place + int(rng.integers(1, 40))
            changed[place:place] = changed[place:end] * int(rng.integers(1, 50))
        elif kind == 4:
            del changed[place:]
        else:
            digits = [i for i, byte in enumerate(changed) if chr(byte).isdigit()]
            if digits:
                changed[digits[rng.integers(len(digits))]] = ord(str(rng.integers(10)))
    return bytes(changed)


def failures(kind: str, whole: Path, read: Reader, count: int) -> collections.Counter[str]:
    """Read mutated files; return what their reader did but return and raise ValueError."""
    content = whole.read_bytes()
    file = whole.with_name(f"mutated{whole.suffix}")
    found: collections.Counter[str] = collections.Counter()
    for seed in range(count):
        file.write_bytes(mutated(content, np.random.default_rng(seed)))
        signal.alarm(LONGEST)
        try:
            read(file)
        except ValueError:
            continue
        except FileNotFoundError:
            if not kind.endswith((".toml", "problem.json")):  # those name other files
                found[f"FileNotFoundError of {kind} (seed {seed})"] += 1
        except Exception as error:
            print(f"{kind}, seed {seed}: {type(error).__name__}: {str(error)[:100]}", flush=True)
            found[type(error).__name__] += 1
    signal.alarm(0)
    return found


def main() -> None:
    """Print a line for each kind of file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kinds", nargs="+", default=[""], help="parts of their names")
    parser.add_argument("-n", type=int, default=1000, help="mutated files of each kind")
    arguments = parser.parse_args()
    signal.signal(signal.SIGALRM, too_long)
    warnings.simplefilter("error", RuntimeWarning)  # a number that nobody looked at
    mujoco.set_mju_user_warning(lambda message: None)
    failed = False
    with tempfile.TemporaryDirectory() as folder:
        files = whole_files(Path(folder))
        files = {
            kind: entry
            for kind, entry in files.items()
            if any(part in kind for part in arguments.kinds)
        }
        for _, (whole, read) in files.items():
            read(whole)
        in_use = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (in_use + ROOM, in_use + ROOM))
        for kind, (whole, read) in files.items():
            began = time.perf_counter()
            found = failures(kind, whole, read, arguments.n)
            failed |= bool(found)
            seconds = time.perf_counter() - began
            print(
                f"{kind}: {dict(found) or 'none fails'} of {arguments.n}, {seconds:.0f} s",
                flush=True,
            )
    sys.exit(failed)


if __name__ == "__main__":
    main()
