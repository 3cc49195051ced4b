"""What moves far in a step meets edges ahead of it where they are, and passes those that it clears.

A ball of radius r touches an edge that stands h above its lowest point where its normal is turned
by sqrt(2 h / r); at the speed v it leaves with v sqrt(2 h / r) upwards at most, and hops by

    v^2 h / (g r) .
"""

import mujoco
import numpy as np
import pytest

import dashpot

GRAVITY = 9.81
TIMESTEPS = pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
# Of the tiles' heights, and so of all that rolls over them.
UNEVEN = 1e-5
TILE = 0.1


def engine_of(world, timestep):
    xml = f'<mujoco><option timestep="{timestep}"/><worldbody>{world}</worldbody></mujoco>'
    return dashpot.Engine(mujoco.MjModel.from_xml_string(xml))


def tiles(length, *, count=14):
    heights = UNEVEN * np.random.default_rng(1).uniform(-1, 1, count)
    boxes = "".join(
        f'<geom type="box" size="{length / 2} 0.2 0.02" pos="{i * length} 0 {height - 0.02}"/>'
        for i, height in enumerate(heights)
    )
    return boxes, heights


def hop_over(heights, *, speed, radius):
    """Height (m) of a hop over the highest of the steps between tiles, from the highest tile."""
    step = np.diff(heights).max()
    return heights.max() + speed**2 * step / (GRAVITY * radius)


@TIMESTEPS
@pytest.mark.parametrize(("radius", "speed"), [(0.03, 2.0), (0.03, 4.0), (0.1, 2.0), (0.01, 1.0)])
def test_ball_rolls_over_tiles_that_are_not_quite_level(radius, speed, timestep):
    boxes, heights = tiles(TILE)
    engine = engine_of(
        f'{boxes}<body pos="0 0 {radius + heights[0]}"><freejoint/>'
        f'<geom size="{radius}" mass="1"/></body>',
        timestep,
    )
    data = engine.make_data()
    data.qvel[[0, 4]] = speed, speed / radius
    top = lowest = 0.0
    for _ in range(round(10 * TILE / speed / timestep)):
        engine.step(data)
        top = max(top, data.qpos[2] - radius)
        lowest = min(lowest, data.qpos[2] - radius)
    # It is on the tiles still: without them it would be 0.3 m below at the least. What it lands
    # with, 0.15 m/s, takes it in by that times a step at the most.
    assert lowest > -UNEVEN - 0.15 * timestep
    # A hop may begin in another; steps of 0.2 ms hop by 1.2 of one.
    assert top < 2.5 * hop_over(heights, speed=speed, radius=radius)
    # Every edge takes the speed normal to it, 2 h / r of its square; tiles are 2 h = 20 um apart.
    assert 1.0 - data.qvel[0] / speed < 10 * 2.0 * UNEVEN / radius


@TIMESTEPS
@pytest.mark.parametrize(
    "wheel", ['type="sphere" size="0.05"', 'type="cylinder" size="0.05 0.02" euler="90 0 0"']
)
def test_wheel_of_a_vehicle_rolls_over_tiles_that_are_not_quite_level(wheel, timestep):
    speed, radius = 3.0, 0.05
    boxes, heights = tiles(0.05, count=60)
    engine = engine_of(
        f'<body><joint type="slide" axis="-1 0 0" armature="1e6"/>{boxes}</body>'
        f'<body pos="0 0 {radius + heights[0]}"><joint type="slide" axis="0 0 1"/>'
        '<inertial pos="0 0 0" mass="4" diaginertia="0.01 0.01 0.01"/>'
        f'<body><joint axis="0 1 0"/><geom {wheel} mass="0.5"/></body></body>',
        timestep,
    )
    data = engine.make_data()
    data.qvel[[0, 2]] = speed, speed / radius
    top = lowest = 0.0
    for _ in range(round(57 * 0.05 / speed / timestep)):
        engine.step(data)
        top = max(top, data.qpos[1])
        lowest = min(lowest, data.qpos[1])
    # It is on the tiles still, as the ball above.
    assert lowest > -2.0 * UNEVEN - 0.15 * timestep
    assert top < 2.5 * hop_over(heights, speed=speed, radius=radius)


@TIMESTEPS
@pytest.mark.parametrize(
    "obstacle",
    [
        'type="box" size="0.3 0.02 0.02" pos="0.1 0.0502 0.02"',
        'type="box" size="0.05 0.02 0.02" pos="0.1 0.05005 0.02"',
        'type="box" size="0.05 0.1 0.01" pos="0.1 0 0.0702"',
        'type="capsule" size="0.01" fromto="0.1 -0.1 0.0702 0.1 0.1 0.0702"',
        'size="0.03" pos="0.1 0.0602 0.03"',
    ],
    ids=["wall", "near wall", "bar", "rod", "ball"],
)
@pytest.mark.parametrize("shape", ["sphere", "box", "cylinder"])
def test_body_passes_what_it_clears(shape, obstacle, timestep):
    # By 0.2 or 0.05 mm. What slides does so almost without friction.
    friction = 1.0 if shape == "sphere" else 1e-5
    size = {"sphere": "0.03", "box": "0.03 0.03 0.03", "cylinder": "0.03 0.03"}[shape]

    def end_with(world):
        engine = engine_of(
            f'<geom type="plane" size="3 3 0.1" friction="{friction}"/>{world}'
            '<body pos="-0.4 0 0.03"><freejoint/>'
            f'<geom type="{shape}" size="{size}" mass="1" friction="{friction}"/></body>',
            timestep,
        )
        data = engine.make_data()
        data.qvel[0] = 2.0
        if shape == "sphere":
            data.qvel[4] = 2.0 / 0.03
        engine.step(data, nstep=round(0.5 / timestep))
        return data

    passed = end_with(f'<geom {obstacle} friction="{friction}"/>')
    alone = end_with("")
    assert passed.qpos[0] > 0.5
    np.testing.assert_allclose(passed.qpos, alone.qpos, atol=1e-9)
    np.testing.assert_allclose(passed.qvel, alone.qvel, atol=1e-9)


@pytest.mark.parametrize("timestep", [0.002, 0.005])
@pytest.mark.parametrize("radius", [0.005, 0.02])
@pytest.mark.parametrize(
    "joints",
    [
        "<freejoint/>",
        '<joint type="slide" axis="1 0 0"/><joint axis="0 1 0" type="slide"/>'
        '<joint type="slide" axis="0 0 1"/>',
    ],
    ids=["free", "on slides"],
)
def test_floor_of_tiles_stops_what_moves_by_more_than_a_tile_in_a_step(joints, radius, timestep):
    # It flies past the end of the tile beneath it, which the next one continues.
    speed, drop = 20.0, 0.1
    floor = "".join(
        f'<geom type="box" size="0.025 0.5 0.02" pos="{0.05 * i - 0.5} 0 -0.02"/>'
        for i in range(21)
    )
    engine = engine_of(f'{floor}<body><geom size="{radius}"/>{joints}</body>', timestep)
    for angle in (0.0, 0.3, 0.8):
        for phase in np.arange(0.0, 1.0, 0.15):
            data = engine.make_data()
            data.qpos[0] = -0.1 - drop * np.tan(angle)
            data.qpos[2] = drop + phase * speed * timestep * np.cos(angle)
            data.qvel[[0, 2]] = speed * np.sin(angle), -speed * np.cos(angle)
            for _ in range(round(0.25 / speed / np.cos(angle) / timestep) + 2):
                engine.step(data)
                if abs(data.qpos[0]) > 0.45:
                    break
                # Its centre stays above the floor: overlap begins at a radius.
                assert data.qpos[2] > 0.0


def valley(facet, *, radius=1.0, half_angle=0.8):
    """Boxes along an arc, by a fiftieth too long, and the angle between them."""
    count = round(2 * half_angle * radius / facet)
    kink = 2 * half_angle / count
    out = radius * np.cos(kink / 2) + 0.01
    boxes = ""
    for i in range(count):
        angle = -half_angle + (i + 0.5) * kink
        boxes += (
            f'<geom type="box" size="{1.02 * radius * np.sin(kink / 2)} 0.1 0.01"'
            f' pos="{out * np.sin(angle)} 0 {radius - out * np.cos(angle)}"'
            f' euler="0 {-np.degrees(angle)} 0"/>'
        )
    return boxes, kink


def start_in_valley(kink):
    """Angle of the middle of a facet, and the distance of a ball on it from the axis."""
    return 0.68 // kink * kink + 0.5 * kink, np.cos(kink / 2) - 0.03


def height_regained(facet, *, timestep):
    boxes, kink = valley(facet)
    angle, centre = start_in_valley(kink)
    engine = engine_of(
        f'{boxes}<body pos="{centre * np.sin(angle)} 0 {1 - centre * np.cos(angle)}"><freejoint/>'
        '<geom size="0.03" mass="1"/></body>',
        timestep,
    )
    data = engine.make_data()
    heights = []
    for _ in range(round(1.2 / timestep)):
        engine.step(data)
        heights.append(data.qpos[2])
    lowest = int(np.argmin(heights))
    return (max(heights[lowest:]) - heights[lowest]) / (heights[0] - heights[lowest])


def height_left_by_kinks(facet):
    """Share of the height: at a kink the spin about the new point stays, (2/5 + cos) / (7/5)."""
    kink = valley(facet)[1]
    angle, centre = start_in_valley(kink)
    keeps = ((np.cos(kink) + 0.4) / 1.4) ** 2

    def height_at(number):
        return 1.0 - np.cos(number * kink) * (1.0 - 0.03 / np.cos(kink / 2))

    first = total = 1.0 - centre * np.cos(angle)
    number = round(angle / kink - 0.5)
    while total > height_at(number):
        total = height_at(number) + keeps * (total - height_at(number))
        number -= 1
    return (total - height_at(0)) / (first - height_at(0))


@pytest.mark.parametrize(
    ("facet", "timestep", "tolerance"),
    [
        # Several steps on every facet: what is left is where in a step it comes to the next, of
        # losses of 3.1 and 1.3 %.
        (0.05, 0.001, 1e-3),
        (0.05, 0.002, 1e-3),
        (0.05, 0.005, 1e-3),
        (0.02, 0.002, 1e-3),
        (0.02, 0.005, 1e-3),
        # One or two facets a step, of which some are met late: 1 % more is lost.
        (0.005, 0.001, 0.01),
        (0.005, 0.002, 0.01),
    ],
)
def test_ball_regains_its_height_in_a_valley_of_boxes(facet, timestep, tolerance):
    left = height_left_by_kinks(facet)
    assert height_regained(facet, timestep=timestep) == pytest.approx(left, abs=tolerance)
