"""What a fit says of parameters together: held ones, vectors, inertia, and nested models."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray
from scipy import special

from dashpot.calibrate.inference.body_inertia import BodyInertia, body_inertia
from dashpot.calibrate.inference.nested import NestedComparison, f_test
from dashpot.calibrate.problem.inertia_setter import InertiaSetter
from dashpot.calibrate.problem.vectors import Joint, vectors_of

if TYPE_CHECKING:
    from dashpot.calibrate.result import Fit

Array = NDArray[np.float64]


class Readback:
    """The methods of `Fit` that put numbers together again."""

    @property
    def held(self) -> dict[str, float]:
        """Values of frozen parameters by name."""
        return dict(cast("Fit", self).problem.held)

    def vector(self, name: str) -> Array:
        """Return the values of a vector parameter, (numbers,); KeyError where there is none.

        Examples
        --------
        >>> shared = Problem(engine, [Parameter.pair("ball", "floor", "friction",
        ...     start=[0.3, 0.01, 0.001], bounds=[(0.1, 1), (1e-4, 0.1), (1e-5, 0.1)]), *unknown],
        ...     [throw], 1e-4, initial_state="given")
        >>> fit(shared, starts=0).vector("friction").shape
        (3,)
        """
        fit = cast("Fit", self)
        found = vectors_of(fit.problem.parameters, fit.values)
        if name not in found:
            raise KeyError(f"no vector named {name!r}; there are {', '.join(found) or 'none'}")
        return np.asarray(found[name])

    def inertia(self, body: str | int, *, trajectory: str | None = None) -> BodyInertia:
        """Return mass, centre and moments of inertia of a body that `Parameter.inertia` varied.

        They have intervals, and statements of what the data do not tell: of a body in free flight
        the ratios of its moments are known, the moments are not.

        Parameters
        ----------
        body
            Name or id, as it was given.
        trajectory
            Whose it is, where there is one for each (``per``); None: the first.

        Raises
        ------
        KeyError
            Where no parameter varies the inertia of the body.

        Examples
        --------
        >>> thrown_box = Problem(engine, [Parameter.inertia("ball", mass=(0.5, 2.0), centre=False,
        ...     shape=False), *unknown], [throw], 1e-4, initial_state="given")
        >>> inertia = fit(thrown_box, starts=0).inertia("ball")
        >>> inertia["mass"].identified  # a throw does not tell it
        False
        """
        fit = cast("Fit", self)
        name = fit.problem.trajectories[0].name if trajectory is None else trajectory
        setters = self._inertia_setters()
        acting = {p.vector for p in fit.problem.parameters if p.acts_in(name)}
        for vector, setter in setters.items():
            if setter.body == body and vector in acting:
                return self._inertia_of(vector, setter)
        known = ", ".join(sorted({str(setter.body) for setter in setters.values()})) or "none"
        raise KeyError(f"no parameter varies the inertia of {body!r}; bodies of such: {known}")

    def against(self, nested: Fit) -> NestedComparison:
        """Return whether the data need what a nested model holds, by an F test.

        Parameters
        ----------
        nested
            A fit of the same problem with some of the parameters frozen, as `Problem.freeze` makes
            it. Where noise is estimated, both have to be fitted with the same, as of
            ``replace(result.problem, noise="stated")``.

        Raises
        ------
        ValueError
            Where it is none of the same data, noise and loss, or holds nothing that this one fits.

        Examples
        --------
        Whether a restitution of 0.7 is good enough:

        >>> held = fit(problem.freeze({"restitution": 0.7}), starts=0)
        >>> bool(result.against(held).p_value < 0.01)
        True
        """
        fit = cast("Fit", self)
        names = tuple(name for name in fit if name not in nested)
        beyond = [name for name in nested if name not in fit]
        if beyond or not names or not {*names} <= {*nested.held}:
            raise ValueError(
                f"the other fit is not nested in this one: it fits {', '.join(nested) or 'nothing'}"
                f" and holds {', '.join(nested.held) or 'nothing'}, this one fits {', '.join(fit)}"
            )
        shapes = [
            [(n, r.shape) for own in f.channel_residuals for n, r in own.items()]
            for f in (fit, nested)
        ]
        if shapes[0] != shapes[1] or (fit.loss, fit.loss_scale) != (nested.loss, nested.loss_scale):
            raise ValueError("the other fit has other data, or another loss")
        problems = fit.problem, nested.problem
        noise = [getattr(problem, "deviations", None) for problem in problems]
        if None not in noise and noise[0] != noise[1]:
            raise ValueError(
                "noise differs between the two fits, so that costs are not compared; fit both with "
                "replace(result.problem, noise='stated')"
            )
        reasons = [
            "a search has not converged" * (not (fit.converged and nested.converged)),
            "residuals hang together, and p is too small" * bool(fit.misfits),
        ]
        gain = nested.cost - fit.cost
        caveat = "; ".join(filter(None, reasons))
        return f_test(names, gain, fit.residual_variance, self._freedom(), caveat)

    def _freedom(self) -> int:
        """Return the degrees of freedom of the noise, or of clusters."""
        fit = cast("Fit", self)
        if fit.errors == "clustered":
            return max(len(fit.problem.trajectories) - 1, 1)
        return max(fit.live_residuals - len(fit.estimates) - fit.states.size, 1)

    def inertias(self) -> dict[str, BodyInertia]:
        """Return by parameter the inertia of each body that was fitted, as `inertia` does."""
        return {name: self._inertia_of(name, s) for name, s in self._inertia_setters().items()}

    def _inertia_setters(self) -> dict[str, InertiaSetter]:
        found = {}
        for p in cast("Fit", self).problem.parameters:
            own = p.apply.function if isinstance(p.apply, Joint) else None
            if isinstance(own, InertiaSetter) and p.vector is not None:
                found[p.vector] = own
        return found

    def _inertia_of(self, vector: str, setter: InertiaSetter) -> BodyInertia:
        fit = cast("Fit", self)
        found = [p for p in fit.problem.parameters if p.vector == vector]
        places = {e.name: i for i, e in enumerate(fit.estimates)}
        chosen = np.array([places.get(p.name, -1) for p in found])
        fitted = np.flatnonzero(chosen >= 0)
        covariance = np.zeros((len(found), len(found)))
        covariance[np.ix_(fitted, fitted)] = fit.covariance[np.ix_(chosen[fitted], chosen[fitted])]
        quantile = special.stdtrit(self._freedom(), 0.5 + 0.5 * fit.confidence)
        return body_inertia(
            setter,
            found,
            [fit.values[p.name] for p in found],
            covariance,
            quantile=float(quantile),
            confidence=fit.confidence,
            unfinished=None if fit.converged else f"the fit has not converged ({fit.message})",
            misfit=bool(fit.misfits),
        )
