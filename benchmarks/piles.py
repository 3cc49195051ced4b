"""Many-body scenes: a pile, bins of mixed bodies, and SimBenchmark's 666 balls."""

from __future__ import annotations

import dataclasses

import numpy as np

from scene import Array, Run, Scene, free_body, mjcf

DENSITY = 1000.0


def mixed_geom(rng: np.random.Generator, size: float) -> str:
    """Return attributes of a random sphere, box or capsule about `size` (m) in radius."""
    a, b, c = size * rng.uniform(0.6, 1.0, 3)
    kind = rng.integers(3)
    if kind == 0:
        return f'type="sphere" size="{a}" density="{DENSITY}"'
    if kind == 1:
        return f'type="box" size="{a} {b} {c}" density="{DENSITY}"'
    return f'type="capsule" size="{0.6 * a} {0.6 * b}" density="{DENSITY}"'


def random_quat(rng: np.random.Generator) -> Array:
    """Return a uniformly distributed unit quaternion (4,)."""
    quat = rng.normal(size=4)
    return quat / np.linalg.norm(quat)


def walls(half: float, height: float) -> str:
    """Return four fixed walls around a square of half width `half` (m)."""
    thick = 0.05
    sides = [
        (half + thick, 0, thick, half + 2 * thick),
        (-half - thick, 0, thick, half + 2 * thick),
        (0, half + thick, half + 2 * thick, thick),
        (0, -half - thick, half + 2 * thick, thick),
    ]
    return "".join(
        f'<geom name="wall{i}" type="box" pos="{x} {y} {height / 2}" size="{a} {b} {height / 2}"/>'
        for i, (x, y, a, b) in enumerate(sides)
    )


def heap(count: int, *, size: float, half: float, seed: int) -> str:
    """Return `count` mixed bodies in random attitudes on a loose grid above a walled square."""
    rng = np.random.default_rng(seed)
    # Grid cells hold any attitude of the largest body: a box with half diagonal sqrt(3) size.
    cell = 2 * np.sqrt(3) * size
    side = max(1, int(2 * half / cell))
    bodies = []
    for i in range(count):
        layer, place = divmod(i, side * side)
        x, y = (np.array(divmod(place, side)) - (side - 1) / 2) * cell
        position = (x, y, cell * (layer + 0.6))
        bodies.append(free_body(f"body{i}", mixed_geom(rng, size), position, quat=random_quat(rng)))
    height = cell * (count // (side * side) + 2)
    return walls(half, height) + "".join(bodies)


def pile(*, count: int = 40, seed: int = 3) -> Scene:
    """Drop 40 mixed bodies of 3 to 5 cm into a bin; overlap while falling and settled."""

    def measure(run: Run) -> dict[str, float]:
        def statistics(first: float, last: float) -> tuple[float, float]:
            rows = (run.time >= first) & (run.time <= last)
            touching = max(1.0, run.touching[rows].sum())
            return run.penetration[rows, 1].sum() / touching, run.penetration[rows, 2].max()

        falling, settled = statistics(0.0, 1.5), statistics(run.time[-1] - 0.5, run.time[-1])
        return {
            "falling mean": falling[0],
            "falling max": falling[1],
            "settled mean": settled[0],
            "settled max": settled[1],
        }

    return Scene(
        name="pile",
        title=f"{count}-body pile, overlap",
        xml=mjcf(heap(count, size=0.05, half=0.2, seed=seed)),
        duration=5.0,
        measure=measure,
        targets={
            "falling mean": 6e-5,
            "falling max": 4e-3,
            "settled mean": 5e-6,
            "settled max": 5e-5,
        },
        units=dict.fromkeys(("falling mean", "falling max", "settled mean", "settled max"), "m"),
        penetration=True,
        timesteps=(0.002,),
    )


# Number of bodies for about 90, 350 and 1,400 settled contacts (four per box face).
BINS = {"bin-90": 27, "bin-350": 98, "bin-1400": 380}


def settled_bin(name: str) -> Scene:
    """Fill one of the bins that the timing runner measures."""
    return dataclasses.replace(bin_of(BINS[name]), name=name)


def bin_of(count: int, *, seed: int = 1) -> Scene:
    """Fill a bin about as high as wide with mixed bodies."""
    size = 0.05
    half = 0.055 * count ** (1 / 3)

    def measure(run: Run) -> dict[str, float]:
        return {
            "settled mean": run.penetration[-1, 1] / max(1.0, run.touching[-1]),
            "settled max": run.penetration[-1, 2],
            "residual speed": float(np.abs(run.qvel[-1]).mean()),
        }

    return Scene(
        name=f"bin of {count}",
        title=f"bin of {count} mixed bodies",
        # The dense Newton solver takes most of a gigabyte in the largest bin.
        xml=mjcf(heap(count, size=size, half=max(half, 0.18), seed=seed)).replace("200M", "2G"),
        duration=3.0,
        measure=measure,
        units={"settled mean": "m", "settled max": "m", "residual speed": "m/s"},
        sample_interval=3.0,
        penetration=True,
        timesteps=(0.002,),
    )


def balls_666(*, side: int = 6, duration: float = 10.0, seed: int = 0) -> Scene:
    """SimBenchmark's 666 test: a cube of balls (0.1 m, 10 kg) falls apart without friction."""
    rng = np.random.default_rng(seed)
    bodies = []
    for i in range(side**3):
        cell = np.array([i % side, i // side % side, i // side**2])
        position = (cell - [(side - 1) / 2, (side - 1) / 2, 0]) * 0.21 + [0, 0, 0.105]
        position += rng.uniform(-1e-3, 1e-3, 3)
        bodies.append(
            free_body(f"ball{i}", 'type="sphere" size="0.1" mass="10" condim="1"', position)
        )

    def measure(run: Run) -> dict[str, float]:
        return {"mean sum of squares": float(run.penetration[:, 0].mean())}

    return Scene(
        name="666",
        title=f"SimBenchmark 666: {side**3} balls, mean sum of squared overlap",
        xml=mjcf("".join(bodies), floor='condim="1"'),
        duration=duration,
        measure=measure,
        targets={"mean sum of squares": 1e-6},
        units={"mean sum of squares": "m^2"},
        penetration=True,
        timesteps=(0.004,),
    )


def many_body() -> list[Scene]:
    """Return the many-body scenes whose numbers are overlaps."""
    return [pile(), balls_666()]
