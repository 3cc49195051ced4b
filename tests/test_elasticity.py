"""Materials of pairs of elastic bodies, against Hertz's law integrated; and the known materials."""

import math

import mujoco
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

from dashpot import Engine, Material
from dashpot.materials import known

STEEL, RUBBER = (210e9, 0.3), (3e6, 0.5)
# Bodies, radii (m): ball on plane, two balls, ball in a hollow, on a rigid plane.
CASES = [
    (STEEL, STEEL, (0.01, math.inf)),
    (STEEL, RUBBER, (0.03, 0.05)),
    (RUBBER, RUBBER, (-0.08, 0.05)),
    (RUBBER, (math.inf, 0.0), (0.02, math.inf)),
]


def hertz(first, second, radii):
    """Return the factor c of ``F = c delta^1.5``."""
    compliance = (1 - first[1] ** 2) / first[0] + (1 - second[1] ** 2) / second[0]
    return 4 / 3 / compliance / math.sqrt(1 / radii[0] + 1 / radii[1])


def material(first, second, radii, **at):
    moduli, ratios = zip(first, second, strict=True)
    return Material.from_elasticity(moduli, ratios, radii, **at)


@pytest.mark.parametrize(("first", "second", "radii"), CASES)
@pytest.mark.parametrize("load", [0.2, 50.0])
def test_small_vibrations_about_the_load_have_the_period_of_the_spring(first, second, radii, load):
    factor, mass = hertz(first, second, radii), 0.3
    stiffness = material(first, second, radii, load=load).stiffness
    rest = (load / factor) ** (2 / 3)
    period = 2 * math.pi * math.sqrt(mass / stiffness)

    # In units of the rest compression and the expected period; released 0.1 % off.
    def motion(_, y):
        return [y[1], (load - factor * (rest * y[0]) ** 1.5) / mass / rest * period**2]

    end = solve_ivp(motion, (0, 1), [1.001, 0.0], rtol=1e-10, atol=1e-13).y[:, -1]
    assert end[0] == pytest.approx(1.001, abs=1e-6)
    assert abs(end[1]) < 2 * math.pi * 1e-3 * 2e-3  # within 0.2 % of a turn of its peak speed


@pytest.mark.parametrize(("first", "second", "radii"), CASES)
@pytest.mark.parametrize(("speed", "mass"), [(0.1, 0.02), (3.0, 1.0)])
def test_the_spring_of_an_impact_is_compressed_as_far(first, second, radii, speed, mass):
    factor = hertz(first, second, radii)
    stiffness = material(first, second, radii, speed=speed, mass=mass).stiffness
    depth = speed * math.sqrt(mass / stiffness)
    time = depth / speed

    def motion(_, y):
        return [y[1], -factor * depth**1.5 / mass * time**2 / depth * max(y[0], 0.0) ** 1.5]

    def turn(_, y):
        return y[1]

    def leave(_, y):
        return y[0] if y[1] < 0 else 1.0

    leave.terminal = True
    found = solve_ivp(
        motion, (0, 4), [0.0, 1.0], events=(turn, leave), rtol=1e-10, atol=1e-12, max_step=0.05
    )
    assert found.y_events[0][0][0] == pytest.approx(1.0, rel=1e-6)
    # As the docstring says: the spring takes 7 % longer, and pushes a fifth less at most.
    assert math.pi / found.t_events[1][0] == pytest.approx(1.067, abs=1e-3)
    assert stiffness * depth / (factor * depth**1.5) == pytest.approx(0.8, rel=1e-9)


def test_a_simulated_ball_is_compressed_as_far_as_by_hertz():
    radius, mass, speed = 0.05, 0.5, 2.0
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep=".0001" gravity="0 0 0"/>
      <worldbody><geom name="floor" type="plane" size="1 1 .1"/>
      <body pos="0 0 {radius + 1e-4}"><freejoint/>
        <geom name="ball" size="{radius}" mass="{mass}"/></body></worldbody></mujoco>""")
    contact = material(RUBBER, STEEL, (radius, math.inf), speed=speed, mass=mass, damping_ratio=0.0)
    engine = Engine(model)
    engine.set_pair_material("ball", "floor", contact)
    data = engine.make_data()
    data.qvel[2] = -speed
    deepest = 0.0
    for _ in range(500):
        deepest = max(deepest, engine.step(data).max_penetration)
    factor = hertz(RUBBER, STEEL, (radius, math.inf))
    assert deepest == pytest.approx((1.25 * mass * speed**2 / factor) ** 0.4, rel=1e-3)


def approach_of_ellipse(ratio):
    """Return the approach of crossed cylinders over that of a sphere of radius ``sqrt(R1 R2)``.

    Johnson, Contact Mechanics, equations 4.25, 4.26 and 4.27.
    """

    def parts(e):
        k, el, slim = ellipk(e * e), ellipe(e * e), math.sqrt(1 - e * e)
        return k, (el / slim**2 - k) * (k - el), (el / slim**2 - k) / (k - el), slim

    e = brentq(lambda e: parts(e)[2] - ratio, 1e-3, 1 - 1e-9)
    k, product, _, slim = parts(e)
    f1 = (4 / math.pi / e**2 * slim**1.5 * math.sqrt(product)) ** (1 / 3)
    return 2 / math.pi * math.sqrt(slim / f1) * k


@pytest.mark.parametrize(("ratio", "error"), [(1.001, 1e-6), (2, 0.01), (3, 0.025), (5, 0.051)])
def test_crossed_cylinders_are_nearly_a_sphere_on_a_plane(ratio, error):
    assert 1 - error <= approach_of_ellipse(ratio) <= 1


def test_other_fields_are_passed_on():
    found = material(STEEL, STEEL, (0.1, 0.1), load=1.0, restitution=0.4, friction=0.2)
    assert (found.restitution, found.friction) == (0.4, 0.2)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"youngs_moduli": (0.0, 1e9)}, "youngs_moduli must be > 0"),
        ({"youngs_moduli": (math.inf, math.inf)}, "must be finite"),
        ({"youngs_moduli": (1e9,)}, "two numbers"),
        ({"poisson_ratios": (0.3, 0.6)}, "poisson_ratios .* 0.6"),
        ({"poisson_ratios": (-1.0, 0.5)}, "poisson_ratios"),
        ({"radii": (math.inf, math.inf)}, "touch at one point"),
        ({"radii": (-0.05, 0.05)}, "touch at one point"),
        ({"radii": (0.0, 0.05)}, "must not be 0"),
        ({"radii": (math.nan, 0.05)}, "touch at one point"),
        ({"load": 0.0}, "load must be finite and > 0"),
        ({"load": None}, "either load, or speed and mass"),
        ({"speed": 1.0, "mass": 1.0}, "either load, or speed and mass"),
        ({"load": None, "speed": 1.0}, "either load, or speed and mass"),
        ({"load": None, "speed": 1.0, "mass": -1.0}, "mass must be finite"),
        ({"restitution": 2.0}, "restitution must be in"),
    ],
)
def test_what_is_out_of_range_is_named(changes, message):
    given = {
        "youngs_moduli": (2e11, 2e11),
        "poisson_ratios": (0.3, 0.3),
        "radii": (0.1, math.inf),
        "load": 1.0,
    }
    with pytest.raises(ValueError, match=message):
        Material.from_elasticity(**{**given, **changes})


NAMES = (
    "steel",
    "aluminium",
    "wood along",
    "wood across",
    "ABS",
    "silicone rubber",
    "nitrile rubber",
    "foam",
    "skin",
    "concrete",
)


@pytest.mark.parametrize("name", NAMES)
def test_each_known_number_is_an_interval_with_a_source(name):
    found = known(name)
    assert found.name == name
    for quantity in (found.youngs_modulus, found.poisson_ratio, found.density):
        if quantity is not None:
            assert quantity.low <= quantity.middle <= quantity.high
            assert any(word in quantity.source for word in ("table", "p. ", "abstract", "3.1.3"))
    assert found.youngs_modulus.low > 0
    if found.poisson_ratio is not None:
        assert -1 < found.poisson_ratio.low <= found.poisson_ratio.high <= 0.5


@pytest.mark.parametrize(
    ("name", "other"),
    [
        ("steel", 207e9),  # Callister and Rethwisch, table B.2
        ("aluminium", 70.3e9),  # Dowling, table 5.2
        ("concrete", (25.4e9 + 36.6e9) / 2),  # Callister and Rethwisch, table B.2
        ("ABS", 2.4e9),  # Dowling, table 5.2
    ],
)
def test_other_sources_lie_within_the_interval(name, other):
    modulus = known(name).youngs_modulus
    assert modulus.low <= other <= modulus.high


def test_wide_intervals_have_their_geometric_mean_in_the_middle():
    assert known("skin").youngs_modulus.middle == pytest.approx(math.sqrt(5e3 * 140e6))
    assert known("steel").youngs_modulus.middle == pytest.approx(200e9)


def test_an_unknown_material_is_told_which_are_known():
    with pytest.raises(ValueError, match=r"no material 'stel' is known; .* did you mean 'steel'"):
        known("stel")


def test_known_materials_make_a_contact():
    steel, wood = known("steel"), known("wood along")
    moduli = [m.youngs_modulus.middle for m in (steel, wood)]
    ratios = [m.poisson_ratio.middle for m in (steel, wood)]
    found = Material.from_elasticity(moduli, ratios, (0.01, math.inf), load=2.0)
    factor = hertz(*zip(moduli, ratios, strict=True), (0.01, math.inf))
    assert found.stiffness == pytest.approx(1.5 * factor ** (2 / 3) * 2.0 ** (1 / 3), rel=1e-12)
