"""Damaged recordings: mutated files of every kind that dashpot reads, and what their readers say.

    python benchmarks/mutated_files.py -n 100000     # an hour and a half of one core

Bytes are changed, left out, repeated and cut off; half of the time numbers of a header are changed.
A reader returns or raises ValueError, in a process whose address space may grow by as much as
`ROOM`. Anything else is printed with its seed, and counts as a failure.
"""

from __future__ import annotations

import argparse
import collections
import json
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np

from dashpot.calibrate import Trajectory
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
PICKLE = (  # of a tensor of (4, 5) doubles, as PyTorch writes it
    b"\x80\x02ctorch._utils\n_rebuild_tensor_v2\nq\x00((X\x07\x00\x00\x00storageq\x01ctorch\n"
    b"DoubleStorage\nq\x02X\x01\x00\x00\x000q\x03X\x03\x00\x00\x00cpuq\x04K\x14tq\x05QK\x00K\x04K\x05"
    b"\x86q\x06K\x05K\x01\x86q\x07\x89ccollections\nOrderedDict\nq\x08)Rq\ttq\nRq\x0b."
)
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
        "tensor.pt": (folder / "tensor.pt", read_tensor),
        "problem.json": (folder / "problem.json", read_problem),
        "problem.toml": (folder / "problem.toml", read_problem),
    }


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
        try:
            read(file)
        except ValueError:
            continue
        except FileNotFoundError:
            if not kind.startswith("problem"):  # those name other files
                found[f"FileNotFoundError of {kind} (seed {seed})"] += 1
        except Exception as error:
            print(f"{kind}, seed {seed}: {type(error).__name__}: {str(error)[:100]}", flush=True)
            found[type(error).__name__] += 1
    return found


def main() -> None:
    """Print a line for each kind of file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", type=int, default=1000, help="mutated files of each kind")
    arguments = parser.parse_args()
    mujoco.set_mju_user_warning(lambda message: None)
    failed = False
    with tempfile.TemporaryDirectory() as folder:
        files = whole_files(Path(folder))
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
