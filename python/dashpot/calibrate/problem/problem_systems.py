"""The systems of a problem: for values of its parameters, and with some of them held."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

from dashpot.calibrate.data.trajectory import Trajectory
from dashpot.calibrate.problem.frozen import frozen_at, released
from dashpot.calibrate.problem.problem_fields import ProblemFields
from dashpot.calibrate.problem.sensing import SensingSetter
from dashpot.calibrate.problem.setters import System
from dashpot.calibrate.problem.systems import own_system, put_in
from dashpot.calibrate.problem.vectors import builder_values

if TYPE_CHECKING:
    from dashpot.calibrate.problem.problem import Problem


class ProblemSystems(ProblemFields):
    """The methods of `Problem` that make systems, and problems nested in it."""

    def freeze(self, values: Iterable[str] | Mapping[str, float]) -> Problem:
        """Return the same problem with parameters held: a nested model.

        Parameters
        ----------
        values
            Values by name, or names of what is held at its start. That of a vector, or of one with
            ``per``, stands for all that it is made of.

        Examples
        --------
        >>> held = problem.freeze({"restitution": 0.6})
        >>> [parameter.name for parameter in held.unknowns]
        ['stiffness']
        """
        return replace(cast("Problem", self), parameters=frozen_at(self.parameters, values))

    def release(self, names: Iterable[str] | str) -> Problem:
        """Return the same problem with frozen parameters fitted, from where they were held.

        Examples
        --------
        >>> problem.freeze("restitution").release("restitution").parameters[1].frozen
        False
        """
        return replace(cast("Problem", self), parameters=released(self.parameters, names))

    def build(self, values: Mapping[str, float], trajectory: str | None = None) -> System:
        """Return a system of its own with `values` (all parameters by name) put in.

        Parameters
        ----------
        values
            Of all parameters; frozen ones may be left out.
        trajectory
            Name of the one of which the system is: parameters that act in others alone are left
            out. None: the first.

        Raises
        ------
        ValueError
            Naming the parameter that is missing or unknown, or whose value was refused.

        Examples
        --------
        >>> candidate = problem.build({"stiffness": 2e4, "restitution": 0.5})
        >>> candidate.pair_material("ball", "floor").stiffness
        20000.0
        """
        self.check_values(values)
        values = {**self.held, **values}
        name = self.trajectories[0].name if trajectory is None else trajectory
        system = own_system(self.system, self._values_in(values, name))
        put_in(system, [p for p in self.parameters if p.acts_in(name)], values)
        return system

    def bare_system(self, values: Mapping[str, float] | None = None) -> System:
        """Return a system of the first trajectory before any parameter is put in.

        Functions that build it get `values`, by default the starts.
        """
        known = self.start if values is None else values
        return own_system(self.system, self._values_in(known, self.trajectories[0].name))

    def check_values(self, values: Mapping[str, float]) -> None:
        """Raise ValueError where `values` are not those of all parameters by name.

        Frozen ones may be left out.
        """
        if not {p.name for p in self.unknowns} <= set(values) <= set(self.names):
            raise ValueError(
                f"values must be given for exactly {', '.join(self.names)}; got {', '.join(values)}"
            )

    def acting(self, trajectory: Trajectory) -> list[bool]:
        """Return for each unknown whether the system of a trajectory depends on it."""
        return [
            p.acts_in(trajectory.name) and not isinstance(p.apply, SensingSetter)
            for p in self.unknowns
        ]

    def _values_in(self, values: Mapping[str, float], trajectory: str) -> dict[str, Any]:
        """Return the values that a function which builds the system of a trajectory gets."""
        return builder_values([p for p in self.parameters if p.acts_in(trajectory)], values)
