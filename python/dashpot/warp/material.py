"""Materials of geoms on the device, their combination, and what a model's own solref means.

Equations as in ``cpp/src/law/material.cpp`` (two springs in series; damping by elastic energy) and
``cpp/include/dashpot/law/solref.hpp``::

    kappa = d^2 k / (1 - d),    delta = d b / sqrt(1 - d)

at the impedance d that a row has at rest under its load. Arrays of shape (k, ngeom) hold for the
worlds ``world % k``.
"""

import warp as wp

from dashpot.warp.state import CONTACT, OF_SITES

wp.set_module_options({"enable_backward": False})

FROM_MODEL = 0
RATIO = 1
DAMPING = 2
RESTITUTION = 3
ROUNDS = 16  # of a bisection

vec5 = wp.types.vector(5, wp.float32)
vec7 = wp.types.vector(7, wp.float32)


@wp.struct
class Pair:
    """What stiffness and damping of a group go by."""

    stiffness: wp.array2d(dtype=wp.float32)  # N/m, 0 for rigid
    damping: wp.array2d(dtype=wp.float32)  # damping ratio or N s/m
    form: wp.array(dtype=wp.int32)
    tangential_ratio: wp.array2d(dtype=wp.float32)
    tangential_damping: wp.array2d(dtype=wp.float32)
    pair_geoms: wp.array(dtype=wp.vec2i)  # pairs that have a material of their own
    pair_values: wp.array(dtype=vec7)
    own_solref: wp.array(dtype=wp.int32)  # geoms that set solref or solimp
    contact_solref: wp.array(dtype=wp.vec2)
    contact_solimp: wp.array(dtype=vec5)
    # By type of constraint: equality, friction of dofs and tendons, limits of joints and tendons.
    own0: wp.array(dtype=wp.int32)
    own1: wp.array(dtype=wp.int32)
    own2: wp.array(dtype=wp.int32)
    own3: wp.array(dtype=wp.int32)
    own4: wp.array(dtype=wp.int32)
    # Inverse masses by which MuJoCo scales them, and where they are found.
    geom_bodyid: wp.array(dtype=wp.int32)
    site_bodyid: wp.array(dtype=wp.int32)
    jnt_dofadr: wp.array(dtype=wp.int32)
    eq_type: wp.array(dtype=wp.int32)
    eq_objtype: wp.array(dtype=wp.int32)
    eq_obj1id: wp.array(dtype=wp.int32)
    eq_obj2id: wp.array(dtype=wp.int32)
    body_invweight0: wp.array2d(dtype=wp.vec2)
    dof_invweight0: wp.array2d(dtype=wp.float32)
    tendon_invweight0: wp.array2d(dtype=wp.float32)
    solref0: wp.array2d(dtype=wp.vec2)
    solref1: wp.array2d(dtype=wp.vec2)
    solref2: wp.array2d(dtype=wp.vec2)
    solref3: wp.array2d(dtype=wp.vec2)
    solref4: wp.array2d(dtype=wp.vec2)
    solimp0: wp.array2d(dtype=vec5)
    solimp1: wp.array2d(dtype=vec5)
    solimp2: wp.array2d(dtype=vec5)
    solimp3: wp.array2d(dtype=vec5)
    solimp4: wp.array2d(dtype=vec5)


@wp.func
def blend(x: float, y: float, share_x: float, share_y: float) -> float:
    """Weighted mean that leaves equal numbers alone and ignores a side of weight 0."""
    if x == y or share_y == 0.0:
        return x
    if share_x == 0.0:
        return y
    return share_x * x + share_y * y


@wp.func
def value_of(values: wp.array2d(dtype=wp.float32), world: int, geom: int) -> float:
    """Return what a geom has in a world."""
    return values[world % values.shape[0], geom]


@wp.func
def pair_index(pair: Pair, key: wp.vec3i) -> int:
    """Which material of its own a pair of geoms has, -1 for none."""
    low = wp.min(key[0], key[1])
    high = wp.max(key[0], key[1])
    for i in range(pair.pair_geoms.shape[0]):
        if pair.pair_geoms[i][0] == low and pair.pair_geoms[i][1] == high:
            return i
    return -1


@wp.func
def pair_material(pair: Pair, world: int, key: wp.vec3i) -> vec7:
    """Stiffness (0: rigid), ratio, damping (-1: none), added damping, restitution, tangents."""
    own = pair_index(pair, key)
    if own >= 0:
        return pair.pair_values[own]
    a = key[0]
    b = key[1]
    ka = value_of(pair.stiffness, world, a)
    kb = value_of(pair.stiffness, world, b)
    da = value_of(pair.damping, world, a)
    db = value_of(pair.damping, world, b)
    fa = pair.form[a]
    fb = pair.form[b]
    ta = value_of(pair.tangential_ratio, world, a)
    tb = value_of(pair.tangential_ratio, world, b)
    za = value_of(pair.tangential_damping, world, a)
    zb = value_of(pair.tangential_damping, world, b)
    if fa == int(FROM_MODEL) and fb == int(FROM_MODEL):
        return vec7(0.0, 1.0, -1.0, 0.0, 0.0, 1.0, 1.0)
    k = float(0.0)
    share_a = float(0.5)
    if ka > 0.0 and kb > 0.0:
        k = wp.min(ka, kb) / (1.0 + wp.min(ka, kb) / wp.max(ka, kb))
        share_a = 1.0 / (1.0 + ka / kb)
    elif ka > 0.0:
        k = ka
        share_a = 1.0
    elif kb > 0.0:
        k = kb
        share_a = 0.0
    share_b = 1.0 - share_a
    # A side that nobody set has no damping of its own to mix in; nor has a rigid one.
    if fa == int(FROM_MODEL):
        fa = fb
        da = db
    elif fb == int(FROM_MODEL):
        fb = fa
        db = da
    elif (ka > 0.0) != (kb > 0.0) and not (fa == int(DAMPING) and fb == int(DAMPING)):
        if ka > 0.0:
            fb = fa
            db = da
        else:
            fa = fb
            da = db
    zeta = float(0.0)
    damping = float(-1.0)
    added = float(0.0)
    if fa == int(DAMPING) and fb == int(DAMPING):
        damping = da
        if pair.form[a] != int(FROM_MODEL) and pair.form[b] != int(FROM_MODEL):
            low = wp.min(da, db)
            damping = wp.where(low > 0.0, low / (1.0 + low / wp.max(da, db)), 0.0)
    elif fa != int(DAMPING) and fb != int(DAMPING):
        zeta = blend(da, db, share_a, share_b)
    elif fa == int(DAMPING):
        zeta = share_b * db
        added = share_a * share_a * da
    else:
        zeta = share_a * da
        added = share_b * share_b * db
    returns = float(0.0)
    if fa == int(RESTITUTION) and fb == int(RESTITUTION):
        returns = 1.0
    ca = share_a / ta
    cb = share_b / tb
    ratio = wp.where(ta == tb, ta, 1.0 / (ca + cb))
    return vec7(
        k, zeta, damping, added, returns, ratio, blend(za, zb, ca / (ca + cb), cb / (ca + cb))
    )


@wp.func
def clip_impedance(value: float) -> float:
    """MuJoCo's bounds."""
    return wp.clamp(value, 1.0e-4, 0.9999)


@wp.func
def impedance(solimp: vec5, gap: float) -> float:
    """MuJoCo's impedance at a gap (m or rad)."""
    start = clip_impedance(solimp[0])
    end = clip_impedance(solimp[1])
    midpoint = clip_impedance(solimp[3])
    power = wp.max(1.0, solimp[4])
    if solimp[2] <= 1.0e-15:
        return 0.5 * (start + end)
    x = wp.abs(gap) / solimp[2]
    if x >= 1.0:
        return end
    if x <= midpoint:
        return start + midpoint * wp.pow(x / midpoint, power) * (end - start)
    rest = (1.0 - midpoint) * wp.pow((1.0 - x) / (1.0 - midpoint), power)
    return start + (1.0 - rest) * (end - start)


@wp.func
def spring_of(solref: wp.vec2, solimp: vec5, load: float) -> wp.vec2:
    """Kappa (1/s^2) and delta (1/s) at rest under a load (m/s^2), which may be infinite."""
    width = clip_impedance(solimp[1])
    k = float(0.0)
    b = float(0.0)
    if solref[0] > 0.0:
        rate = 1.0 / (width * solref[0])
        k = (rate / solref[1]) * (rate / solref[1])
        b = 2.0 * rate
    else:
        k = -solref[0] / (width * width)
        b = -solref[1] / width
    d = width
    if load < wp.inf and k > 0.0 and solimp[2] > 0.0:
        # d^2 k x = (1 - d) load, by bisection over the width.
        low = float(0.0)
        high = solimp[2]
        rounds = int(ROUNDS)
        for _ in range(rounds):  # no constant: the loop is not to be unrolled
            x = 0.5 * (low + high)
            d = impedance(solimp, x)
            if d * d * k * x < (1.0 - d) * load:
                low = x
            else:
                high = x
        d = impedance(solimp, 0.5 * (low + high))
    return wp.vec2(d * d * k / (1.0 - d), d * b / wp.sqrt(1.0 - d))


@wp.func
def solref_rates(
    pair: Pair, world: int, key: wp.vec3i, source: int, kind: int, load: float
) -> wp.vec2:
    """Return kappa and delta by the model's own solref; 0 without one, or beside a material."""
    own = int(0)
    solref = wp.vec2(0.0, 0.0)
    solimp = vec5(0.0)
    index = key[1]
    which = key[0] + 100
    if kind == int(CONTACT):
        a = key[0]
        b = key[1]
        if pair.form[a] == int(FROM_MODEL) and pair.form[b] == int(FROM_MODEL):
            own = wp.max(pair.own_solref[a], pair.own_solref[b])
        if own != 0 and pair_index(pair, key) >= 0:
            own = 0
        solref = pair.contact_solref[source]
        solimp = pair.contact_solimp[source]
    elif which == 0:
        own = pair.own0[index]
        solref = pair.solref0[world % pair.solref0.shape[0], index]
        solimp = pair.solimp0[world % pair.solimp0.shape[0], index]
    elif which == 1:
        own = pair.own1[index]
        solref = pair.solref1[world % pair.solref1.shape[0], index]
        solimp = pair.solimp1[world % pair.solimp1.shape[0], index]
    elif which == 2:
        own = pair.own2[index]
        solref = pair.solref2[world % pair.solref2.shape[0], index]
        solimp = pair.solimp2[world % pair.solimp2.shape[0], index]
    elif which == 3:
        own = pair.own3[index]
        solref = pair.solref3[world % pair.solref3.shape[0], index]
        solimp = pair.solimp3[world % pair.solimp3.shape[0], index]
    else:
        own = pair.own4[index]
        solref = pair.solref4[world % pair.solref4.shape[0], index]
        solimp = pair.solimp4[world % pair.solimp4.shape[0], index]
    if own == 0:
        return wp.vec2(0.0, 0.0)
    return spring_of(solref, solimp, load)


@wp.func
def of_object(pair: Pair, world: int, kind: int, index: int, part: int) -> float:
    """Inverse mass of a body (0 translation, 1 rotation), a joint or a tendon of an equality."""
    if index < 0:
        return 0.0
    if kind < 2:
        at = world % pair.body_invweight0.shape[0]
        return pair.body_invweight0[at, index][part]
    if kind == 2:
        at = world % pair.dof_invweight0.shape[0]
        return pair.dof_invweight0[at, pair.jnt_dofadr[index]]
    return pair.tendon_invweight0[world % pair.tendon_invweight0.shape[0], index]


@wp.func
def typical_inverse_mass(pair: Pair, world: int, key: wp.vec3i, kind: int) -> float:
    """Return the one by which MuJoCo makes a spring of a solref, 1/kg or 1/(kg m^2)."""
    index = key[1]
    which = key[0] + 100
    if kind == int(CONTACT):
        mass = of_object(pair, world, 0, pair.geom_bodyid[key[0]], 0)
        return mass + of_object(pair, world, 0, pair.geom_bodyid[key[1]], 0)
    if which == 0:
        part = wp.where(key[2] > 2, 1, 0)  # rows of a weld that turn
        first = pair.eq_obj1id[index]
        second = pair.eq_obj2id[index]
        if pair.eq_objtype[index] == int(OF_SITES):
            first = pair.site_bodyid[first]
            second = pair.site_bodyid[second]
        type = pair.eq_type[index]
        total = of_object(pair, world, type, first, part)
        return total + of_object(pair, world, type, second, part)
    if which == 2 or which == 4:
        return of_object(pair, world, 3, index, 0)
    if which == 3:
        return of_object(pair, world, 2, index, 0)
    return pair.dof_invweight0[world % pair.dof_invweight0.shape[0], index]
