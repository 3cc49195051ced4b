"""Time of impact against dense sampling and bisection of independent gaps.

    python benchmarks/time_of_impact.py            # 1,000 cases of each kind, a few minutes
    python benchmarks/time_of_impact.py -n 100

Cases: a ball at 100 m/s against a plate of 1 mm, a spinning box above the ground, two tumbling
boxes, a tumbling mesh against a tumbling capsule, a tumbling box above a height field of 6 x 5
points; sizes, poses, velocities, spins and heights drawn anew.

Reference (`impact_references`): the gap of the two as a function of time, from closed forms that
share nothing with dashpot: distance of a point from a box; height of the lowest corner; the largest
gap along the 15 separating axes of two boxes; distances of the capsule's segment from the faces and
edges of the hull; the least over all prisms of the largest gap along their separating axes from the
box. It is sampled at 2,000 times (mesh and height field: 600), every local minimum before the first
contact is sampled again down to 1e-9 of the horizon, and the first zero is narrowed to rounding.

A contact is missed where the reference finds one deeper than 1e-9 m and the query none; it is
false where the query finds one and the gap stays above the clearance that counts as contact, 1e-9
of the size. `late` counts times after the first contact by more than 1e-12 of the horizon. The
error is how early a time is, as a part of the horizon.
"""

from __future__ import annotations

import argparse
import time

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

import dashpot
from free_flight import Motion, launch, throw_together
from impact_references import (
    ball_and_box,
    box_and_ground,
    box_and_prisms,
    first_contact,
    hull_and_capsule,
    two_boxes,
)
from query_geoms import hull_mesh, hull_points, prism_corners, shape, unit
from scene import free_body

CLEARANCE = 1e-9  # m, of shapes whose sizes add up to less than 1 m


def scene(bodies):
    return mujoco.MjModel.from_xml_string(
        f"<mujoco><asset>{hull_mesh(hull_points())}</asset><worldbody>{bodies}</worldbody></mujoco>"
    )


def free(name, attributes):
    return free_body(name, attributes, (0, 0, 0))


def ball_against_plate(rng):
    radius = rng.uniform(0.002, 0.02)
    model = scene(
        free("a", f'type="sphere" size="{radius}" mass="1"')
        + free("b", 'type="box" size="0.2 0.2 0.0005" mass="1"')
    )
    data = mujoco.MjData(model)
    turn = Rotation.random(random_state=rng)
    aim = turn.apply(np.append(rng.uniform(-0.22, 0.22, size=2), 0.0))
    velocity = 100.0 * unit(rng.normal(size=3))
    start = aim - velocity * rng.uniform(0.002, 0.008)
    launch(model, data, "a", start, None, velocity, rng.normal(size=3) * 100)
    launch(model, data, "b", (0, 0, 0), turn)
    return model, data, 0.01, ball_and_box, 2000


def box_above_ground(rng):
    size = " ".join(map(str, rng.uniform(0.03, 0.2, size=3)))
    model = scene(
        '<geom name="b" type="plane" size="1 1 1"/>' + free("a", f'type="box" size="{size}"')
    )
    data = mujoco.MjData(model)
    velocity = np.append(rng.normal(size=2), rng.uniform(-6, 0.5))
    launch(
        model,
        data,
        "a",
        (0, 0, rng.uniform(0.36, 0.9)),
        Rotation.random(random_state=rng),
        velocity,
        rng.normal(size=3) * 20,
    )
    return model, data, 0.2, box_and_ground, 2000


def tumble(model, rng):
    data = mujoco.MjData(model)
    throw_together(model, data, rng, "ab", side=0.3, spread=0.05)
    return data


def tumbling_boxes(rng):
    sizes = [" ".join(map(str, rng.uniform(0.03, 0.13, size=3))) for _ in range(2)]
    model = scene(
        "".join(free(n, f'type="box" size="{s}"') for n, s in zip("ab", sizes, strict=True))
    )
    return model, tumble(model, rng), 0.06, two_boxes, 2000


def mesh_against_capsule(rng):
    size = f"{rng.uniform(0.02, 0.08)} {rng.uniform(0.03, 0.12)}"
    model = scene(free("a", shape("mesh")) + free("b", f'type="capsule" size="{size}"'))
    gap = hull_and_capsule(model.mesh_vert.astype(float))
    return model, tumble(model, rng), 0.06, gap, 600


def box_above_hills(rng):
    rows, columns = 6, 5
    half_x, half_y, elevation, base = 0.3, 0.4, 0.15, 0.05
    size = " ".join(map(str, rng.uniform(0.02, 0.1, size=3)))
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><asset><hfield name="hills" nrow="{rows}" ncol="{columns}"
        size="{half_x} {half_y} {elevation} {base}"/></asset><worldbody>
        <geom name="b" type="hfield" hfield="hills" euler="10 -20 30"/>
        {free("a", f'type="box" size="{size}"')}</worldbody></mujoco>"""
    )
    model.hfield_data[:] = rng.random(rows * columns)
    data = mujoco.MjData(model)
    start = np.append(rng.uniform(-0.4, 0.4, size=2), rng.uniform(0.35, 0.5))
    velocity = np.append(rng.normal(size=2), rng.uniform(-12, -2))
    turn = Rotation.random(random_state=rng)
    launch(model, data, "a", start, turn, velocity, rng.normal(size=3) * 30)
    prisms = prism_corners(
        model.hfield_size[0], model.hfield_data.astype(float).reshape(rows, columns)
    )
    world = prisms @ data.geom("b").xmat.reshape(3, 3).T + data.geom("b").xpos
    return model, data, 0.06, box_and_prisms(world), 600


CASES = {
    "ball at 100 m/s, plate of 1 mm": ball_against_plate,
    "spinning box, ground": box_above_ground,
    "two tumbling boxes": tumbling_boxes,
    "tumbling mesh, tumbling capsule": mesh_against_capsule,
    "tumbling box, height field": box_above_hills,
}


def measure(make, count, seed):
    """Numbers of contacts and of missed, false and late ones; errors; times of a call in s."""
    rng = np.random.default_rng(seed)
    number = dict.fromkeys(("contacts", "missed", "false", "late"), 0)
    errors, spent = [], []
    for _ in range(count):
        model, data, horizon, gap_of, samples = make(rng)
        gap = gap_of(Motion(model, data, "a"), Motion(model, data, "b"))
        if gap(np.zeros(1))[0] <= 0.0:
            expected, least = 0.0, -np.inf
        else:
            expected, least = first_contact(gap, horizon, samples)
        start = time.perf_counter()
        found = dashpot.time_of_impact(model, data, "a", "b", horizon=horizon)
        spent.append(time.perf_counter() - start)
        touches = expected <= horizon
        number["contacts"] += touches
        if touches and not found.hit:
            number["missed"] += least < -CLEARANCE
        elif found.hit and not touches:
            number["false"] += least > CLEARANCE
        elif found.hit:
            errors.append((expected - found.time) / horizon)
            number["late"] += errors[-1] < -1e-12
    return number, errors, spent


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", "--count", type=int, default=1000, help="cases of each kind")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    print("| case | contacts | missed | false | late | median error | worst error | median time |")
    print("|---|---|---|---|---|---|---|---|")
    for label, make in CASES.items():
        number, errors, spent = measure(make, arguments.count, arguments.seed)
        print(
            f"| {label} | {number['contacts']} of {arguments.count} | {number['missed']} "
            f"| {number['false']} | {number['late']} | {np.median(errors):.0e} "
            f"| {max(errors):.0e} | {1e6 * np.median(spent):.0f} us |",
            flush=True,
        )


if __name__ == "__main__":
    main()
