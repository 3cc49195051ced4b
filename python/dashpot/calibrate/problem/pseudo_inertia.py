"""Mass, centre and rotational inertia of a body, by a Cholesky factor of its pseudo-inertia.

The pseudo-inertia of a body is the matrix (4, 4) of the second moments of its mass, with a point x
written as (x, 1). It is positive definite for every body of some thickness, and for nothing else:
mass is then > 0, and each principal moment less than the sum of the others. Rucker and Wensing
(Smooth parameterization of rigid-body inertia, IEEE Robotics and Automation Letters 7, 2771-2778,
2022) take it as ``U U^T``, U upper triangular with the exponentials of numbers on its diagonal, so
that any ten numbers make a body. The same ten, in terms that mean something by themselves:

    J = m [ s^2 A L L^T A^T + c c^T    c ]        L = [ a  p  q      ]
          [ c^T                        1 ]            [ 0  b  r      ]
                                                      [ 0  0  1/(ab) ]

* ``mass`` m, kg,
* ``centre`` c of mass, in the frame of the body, m,
* ``size`` s: the geometric mean of how far mass spreads along three axes (standard deviations), m;
  of a solid box the third root of its half lengths' product, over the root of 3,
* ``stretch`` a, b: how much of that is along the first and the second axis,
* ``shear`` p, q, r: how these axes lean against those of the model, A.

Motions without known forces tell neither the mass nor the size: they scale with it alone. What they
do tell is then in the other eight.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MASS = ("mass",)
CENTRE = ("centre x", "centre y", "centre z")
SHAPE = ("size", "stretch x", "stretch y", "shear xy", "shear xz", "shear yz")
NUMBERS = (*MASS, *CENTRE, *SHAPE)
"""Names of the ten numbers."""

# Thinner bodies, as plates and rods without a thickness, count as so thick.
_THINNEST = 1e-3


def numbers_of(mass: float, centre: Array, moments: Array) -> Array:
    """Return the ten numbers of a body, L along the principal axes of its inertia.

    Parameters
    ----------
    mass
        kg, > 0.
    centre
        (3,) m.
    moments
        (3,) principal moments of inertia, kg m^2, each at most the sum of the others.
    """
    spread = np.sqrt(np.maximum((0.5 * moments.sum() - moments) / mass, 0.0))
    spread = np.maximum(spread, _THINNEST * spread.max())
    size = float(np.cbrt(spread.prod()))
    return np.array([mass, *centre, size, *(spread[:2] / size), 0.0, 0.0, 0.0])


def body_of(numbers: Array, axes: Array) -> tuple[float, Array, Array]:
    """Return mass (kg), centre (3,) (m) and inertia (3, 3) about it, in the frame of the body.

    Parameters
    ----------
    numbers
        (10,); mass, size and stretches > 0.
    axes
        (3, 3) the axes of L, A, as columns.
    """
    mass, size = float(numbers[0]), float(numbers[4])
    a, b, p, q, r = numbers[5:]
    factor = size * axes @ np.array([[a, p, q], [0.0, b, r], [0.0, 0.0, 1.0 / (a * b)]])
    spread = factor @ factor.T
    return mass, numbers[1:4].copy(), mass * (np.trace(spread) * np.eye(3) - spread)


def principal(inertia: Array) -> tuple[Array, Array]:
    """Return moments (3,), the largest first, and axes (3, 3) as columns, of the right hand."""
    moments, axes = np.linalg.eigh(inertia)
    moments, axes = moments[::-1], axes[:, ::-1].copy()
    if np.linalg.det(axes) < 0.0:
        axes[:, 2] *= -1.0
    return moments, axes
