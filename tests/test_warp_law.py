"""The law's kernels in single precision against the C++ law, number by number."""

import re
from pathlib import Path

import numpy as np
import pytest

from dashpot import _core
from warp_worlds import dw, wp  # noqa: F401  (sets the CPU device)

from dashpot.warp import law  # isort: skip

COUNT = 20_000


@wp.kernel(enable_backward=False)
def flow_all(p: wp.array2d(dtype=float), out: wp.array(dtype=law.vec2)):
    i = wp.tid()
    e = law.propagate_later(p[i, 2] * p[i, 1], p[i, 2] * p[i, 0], p[i, 6])
    out[i] = law.flow_normal(p[i, 0], p[i, 1], p[i, 2], e, p[i, 3], p[i, 4], p[i, 5], p[i, 6])


@wp.kernel(enable_backward=False)
def spring_all(p: wp.array2d(dtype=float), out: wp.array(dtype=law.vec2)):
    i = wp.tid()
    e = law.propagate_later(p[i, 2] * p[i, 1], p[i, 2] * p[i, 0], p[i, 6])
    out[i] = law.flow_spring(p[i, 0], p[i, 1], e, p[i, 3], p[i, 4], p[i, 5])


@wp.kernel(enable_backward=False)
def return_all(
    trial: wp.array(dtype=wp.vec3),
    inverse_mu: wp.array(dtype=wp.vec3),
    slip: wp.array(dtype=wp.vec3),
    out: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    out[i] = law.return_to_limit(trial[i], inverse_mu[i], slip[i], 1.0)


def random_contacts():
    """Contacts that begin, end and last within a micro-step, kappa h^2 up to 3, ratio up to 1."""
    rng = np.random.default_rng(0)
    h, w = 10 ** rng.uniform(-5, -3, COUNT), 10 ** rng.uniform(-2, 2, COUNT)
    k = 10 ** rng.uniform(-4, 0.5, COUNT) / (w * h * h)
    d = 2 * rng.uniform(0, 1, COUNT) * np.sqrt(k / w)
    u = rng.normal(size=COUNT)
    x = rng.normal(size=COUNT) * np.abs(u) * h * 2
    b = rng.normal(size=COUNT) * np.abs(u) / h
    return np.stack([k, d, w, x, u, b, h], axis=1).astype(np.float32)


def errors(found, exact, scale):
    return np.abs(found - exact) / np.maximum(np.abs(exact), 1e-3 * scale)


def test_contacts_are_those_of_the_core():
    given = random_contacts()
    out = wp.zeros(COUNT, dtype=law.vec2)
    wp.launch(flow_all, dim=COUNT, inputs=[wp.array(given)], outputs=[out])
    exact = _core.flow_contact(*given.T.astype(float))
    momentum = np.abs(given[:, 4]) / given[:, 2]
    for i, scale in ((0, momentum), (1, momentum * given[:, 6])):
        error = errors(out.numpy()[:, i], np.asarray(exact[i]), scale)
        # Onset and release amplify rounding of the inputs: 2^-24 a hundredfold at most.
        assert np.quantile(error, 0.99) < 1e-6
        assert error.max() < 2e-5


def test_springs_are_those_of_the_core():
    given = random_contacts()
    out = wp.zeros(COUNT, dtype=law.vec2)
    wp.launch(spring_all, dim=COUNT, inputs=[wp.array(given)], outputs=[out])
    exact = _core.flow_spring(*given.T.astype(float))
    k, d, _, x, u, b, h = np.abs(given.T.astype(float))
    terms = (k * x + d * u) * h + (k * u + d * b) * h**2 + k * b * h**3
    # Terms cancel; rounding is that of the largest.
    assert (np.abs(out.numpy()[:, 0] - np.asarray(exact[0])) / terms).max() < 1e-6


def test_friction_returns_to_the_limit_of_the_core():
    rng = np.random.default_rng(1)
    count = 500
    trial, mu = rng.normal(size=(count, 3)) * 3, rng.uniform(0.1, 2, (count, 3))
    response = 10 ** rng.uniform(-2, 0, (count, 3))
    slip = response / mu**2
    slip /= slip.max(axis=1, keepdims=True)
    out = wp.zeros(count, dtype=wp.vec3)
    given = [wp.array(a, dtype=wp.vec3) for a in (trial, 1 / mu, slip)]
    wp.launch(return_all, dim=count, inputs=given, outputs=[out])
    exact = np.asarray(_core.return_to_limit(trial, mu, response, np.ones(count))[0])
    np.testing.assert_allclose(out.numpy(), exact, atol=5e-6)


ROOT = Path(__file__).parents[1]
EQUATIONS = {
    "law": {
        "law/kelvin_voigt.hpp": (
            "g'' = b + w f",
            "f = max(0, -k g - d g')",
            "f0 E1 - (k u0 + d b) E2 - k b E3",
            "f0 E2 - (k u0 + d b) E3 - k b E4",
            "u0 + b t + w p",
            "g0 + u0 t + b t^2/2 + w r",
        ),
        "law/propagator.hpp": ("y'' + w d y' + w k y = t^(n-2)/(n-2)!",),
        "law/friction.hpp": ("t_i / (1 + gamma c_i / mu_i^2)",),
    },
    "group": {
        "solve/microstep.hpp": ("h u + h^2/2 b + w r + s h (u' - u - h b - w p),   s = 1/3",)
    },
    "comfree": {
        "solve/comfree.hpp": (
            "max(0, m (-d v_p - k (g + dt v_p)))",
            "k = k_user / dt",
            "d = d_user / dt",
            "u_n +- mu_i u_i",
            "m = imp / ((1 - imp) w_0)",
        )
    },
}


def plain(text):
    """Return what an equation says, without how it is set."""
    text = re.sub(r"\s|`|//|\(t\)|\*", "", text)
    return text.replace("d'", "d").replace("_0", "0").replace("_", "")


@pytest.mark.parametrize("name", EQUATIONS)
def test_a_kernels_file_opens_with_the_equations_of_its_headers(name):
    opening = (ROOT / f"python/dashpot/warp/{name}.py").read_text().split('"""')[1]
    for header, equations in EQUATIONS[name].items():
        assert f"cpp/include/dashpot/{header}" in opening or Path(header).name in opening
        meant = plain((ROOT / "cpp/include/dashpot" / header).read_text())
        for equation in equations:
            assert plain(equation) in meant, equation
            assert plain(equation) in plain(opening), equation


def test_headers_that_kernels_name_are_there():
    for path in (ROOT / "python/dashpot/warp").glob("*.py"):
        text = path.read_text()
        assert len(text.splitlines()) <= 400, path.name
        for header in re.findall(r"cpp/[\w/]+\.[hc]pp", text):
            assert (ROOT / header).exists(), (path.name, header)
