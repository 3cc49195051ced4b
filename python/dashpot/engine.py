"""Stepping MuJoCo models with dashpot's contact solver."""

from __future__ import annotations

import copy
import importlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

import mujoco
import numpy as np
from numpy.typing import NDArray

from dashpot import _core
from dashpot.checks import is_data_of, positive_count, whole_number
from dashpot.contact_material import ContactMaterial
from dashpot.contacts import Contacts, Energy, names_of_sides, of_objects
from dashpot.engine_options import EngineOptions, ReadableOptions
from dashpot.features import Feature, Report, replaced_by_materials
from dashpot.idle_friction import warn_of_idle_friction
from dashpot.materials import CombinationRules, Material
from dashpot.mjcf_materials import read_materials
from dashpot.model_locks import new_lock
from dashpot.model_sources import ModelLike, compiled
from dashpot.object_ids import Element, object_id
from dashpot.original_edits import Original, original_of

__all__ = ["DivergenceError", "Engine", "StepStats"]

DivergenceError = _core.DivergenceError
StepStats = _core.StepStats
_Key = TypeVar("_Key", int, tuple[int, int])


@dataclass
class _Built:
    """What an engine has made of its materials. A thread that uses it keeps all of it."""

    parameters: _core.Parameters | None = None
    stepper: _core.Stepper | None = None
    rollouts: _core.RolloutWorkers | None = None


class Engine(ReadableOptions):
    """Steps an unmodified MuJoCo model with dashpot's own contact solver.

    The engine works on a private copy of the model, :attr:`model`, with room for contact memory in
    its user data and elliptic cones. :meth:`make_data` makes ordinary ``mujoco.MjData`` that carry
    that memory. Edit :attr:`model` between steps; sizes and options are fixed. Threads may share an
    engine, each with data of its own. The guide "Options of an engine" says more of each option.

    Parameters
    ----------
    model
        Compiled model, an ``MjSpec``, the path of an MJCF, URDF or MJB file, or MJCF text. Geoms
        start rigid with their MJCF friction, or with the ``solref`` and ``solimp`` that it sets.
    law
        ``"kelvin_voigt"``, or ``"comfree"``: the published complementarity-free update.
    microsteps
        Micro-steps per step, >= 1, or ``"auto"``.
    max_microsteps
        Upper bound of them; stiffness beyond it is lowered and counted in ``StepStats.clipped``.
    recovery_speed
        m/s, > 0: how fast overlap that no spring has taken up is pushed out, at most.
    mocap_timeconst
        s, >= 0: time constant with which mocap bodies follow their poses.
    impact
        ``"none"``, or ``"cut"``: a step ends where a fast, thin or small geom meets another.
    rules
        How the materials of two geoms combine.
    comfree_stiffness, comfree_damping
        Of law ``"comfree"``: k in 1/s, > 0, and d, >= 0. None: 0.2 and 0.001.
    nthread
        Threads, 1 to 128, that share a step. Results are the same bit for bit.

    Raises
    ------
    TypeError
        If an argument has the wrong type.
    FileNotFoundError
        If there is no such file.
    ValueError
        If an option is out of range or of the other law, the model cannot be compiled, or it uses
        a feature that the engine refuses; the message names it.

    Examples
    --------
    >>> model = mujoco.MjModel.from_xml_string('''<mujoco><worldbody>
    ...   <geom type="plane" size="1 1 .1"/>
    ...   <body pos="0 0 .1"><freejoint/><geom size=".1" mass="1"/></body>
    ... </worldbody></mujoco>''')
    >>> engine = dashpot.Engine(model)
    >>> data = engine.make_data()
    >>> stats = engine.step(data, nstep=500)
    >>> print(engine.contacts(data).force[0, 0].round(2))
    9.81
    """

    __slots__ = (
        "__weakref__",
        "_built",
        "_calls",
        "_contact_capacity",
        "_geom_material",
        "_lock",
        "_looks_at",
        "_model",
        "_nthread",
        "_original",
        "_pair_material",
        "_scratch",
        "_side_names",
    )

    def __init__(
        self,
        model: ModelLike,
        *,
        law: str = EngineOptions.law,
        microsteps: int | Literal["auto"] = EngineOptions.microsteps,
        max_microsteps: int = EngineOptions.max_microsteps,
        recovery_speed: float = EngineOptions.recovery_speed,
        mocap_timeconst: float = EngineOptions.mocap_timeconst,
        impact: Literal["none", "cut"] = EngineOptions.impact,
        rules: CombinationRules | None = None,
        comfree_stiffness: float | None = None,
        comfree_damping: float | None = None,
        nthread: int = 1,
    ) -> None:
        given, model = model, compiled(model)
        self._options = EngineOptions(
            law=law,
            microsteps=microsteps,
            max_microsteps=max_microsteps,
            recovery_speed=recovery_speed,
            mocap_timeconst=mocap_timeconst,
            impact=impact,
            rules=EngineOptions.rules if rules is None else rules,
            comfree_stiffness=comfree_stiffness,
            comfree_damping=comfree_damping,
        )
        self._nthread = whole_number("nthread", nthread, lowest=1, highest=_core.MAX_THREADS)
        _core.check_supported(model._address, self._options.to_core())
        self._model: mujoco.MjModel = copy.deepcopy(model)
        self.model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        self._contact_capacity = _core.reserve_memory(self.model._address)
        self._geom_material: dict[int, Material] = {}
        self._pair_material: dict[tuple[int, int], Material] = {}
        if self.law != "comfree":
            self._geom_material, self._pair_material = read_materials(self.model)
        self._lock = new_lock()
        self._built = _Built()
        self._scratch: mujoco.MjData | None = None
        self._side_names: NDArray[np.str_] | None = None
        self._calls, self._looks_at = 0, 1
        self._original: Original | None = None
        if given is model:
            self._original = original_of(model, self._model)

    @property
    def model(self) -> mujoco.MjModel:
        """The private copy of the model that the engine steps.

        Its values may be edited between steps; another model needs an engine of its own.
        """
        return self._model

    @property
    def nthread(self) -> int:
        """Number of threads that share the passes of a step."""
        return self._nthread

    @property
    def materials(self) -> dict[int, Material]:
        """Materials that were set, by geom id (a copy)."""
        return dict(self._geom_material)

    @property
    def pair_materials(self) -> dict[tuple[int, int], Material]:
        """Materials that were set for pairs, by (lower, higher) geom id (a copy)."""
        return dict(self._pair_material)

    def geom_id(self, geom: Element) -> int:
        """Id of a geom given by name or id; raises ValueError naming an unknown one.

        Examples
        --------
        >>> engine.geom_id("ball")
        1
        """
        return object_id(self.model, geom, "geom", "geom")

    def body_geoms(self, body: Element) -> tuple[int, ...]:
        """Ids of a body's own geoms (not its children's): many have no names of their own.

        Examples
        --------
        >>> engine = dashpot.Engine(model)
        >>> rubber = dashpot.Material(1e5, restitution=0.8)
        >>> engine.set_materials(dict.fromkeys(engine.body_geoms("ball"), rubber))
        """
        index = object_id(self.model, body, "body", "body")
        first = int(self.model.body_geomadr[index])
        return tuple(range(first, first + int(self.model.body_geomnum[index])))

    def set_material(self, geom: Element, material: Material | None) -> None:
        """Give a geom a material; contacts combine those of both geoms. None: the model's own.

        By default the larger friction of the two counts, as in MuJoCo: for less, set both geoms,
        or the pair with :meth:`set_pair_material`. A material with friction takes the place of that
        of a ``<pair>`` of the MJCF, too: the other geom then counts with its own.

        A ``UserWarning`` names friction that no contact of the geom takes, as those of all geoms
        that it could touch count. Where these follow, give all at once with :meth:`set_materials`.

        Examples
        --------
        >>> engine = dashpot.Engine(model)
        >>> engine.set_material("ball", dashpot.Material(1e5, restitution=0.8))
        >>> engine.contact_material("ball", "floor").stiffness
        100000.0
        """
        self._give({geom: material})
        self._warn_of_idle_friction([geom])

    def set_materials(self, materials: Mapping[Any, Material | None]) -> None:
        """Give several geoms a material each, as :meth:`set_material` does, all at once or none.

        Examples
        --------
        >>> engine = dashpot.Engine(model)
        >>> slippery = dashpot.Material(friction=0.1)
        >>> engine.set_materials({"box": slippery, "floor": slippery})
        >>> engine.contact_material("box", "floor").friction[0]
        0.1
        """
        self._give(materials)
        self._warn_of_idle_friction(materials)

    def set_pair_material(self, geom1: Element, geom2: Element, material: Material | None) -> None:
        """Give contacts between two geoms a material of their own, in place of the combination.

        None: the combination again.

        Examples
        --------
        >>> engine = dashpot.Engine(model)
        >>> engine.set_pair_material("ball", "floor", dashpot.Material(1e4, friction=0.1))
        >>> engine.contact_material("floor", "ball").friction[0]
        0.1
        """
        self._put_in(self._pair_material, {self._geom_pair(geom1, geom2): material})

    def material(self, geom: Element) -> Material:
        """Material set for a geom; ``Material()`` where none was.

        What contacts have then may also come from the model's ``solref``: see
        :meth:`contact_material`.

        Examples
        --------
        >>> engine.material("box").stiffness is None  # rigid
        True
        """
        return self._geom_material.get(self.geom_id(geom), Material())

    def pair_material(self, geom1: Element, geom2: Element) -> Material | None:
        """Material set for a pair of geoms, or None where the combination applies.

        What applies then is :meth:`contact_material`. ValueError if a geom is unknown or both are
        the same.

        Examples
        --------
        >>> engine.pair_material("floor", "ball").restitution
        0.6
        """
        return self._pair_material.get(self._geom_pair(geom1, geom2))

    def contact_material(self, geom1: Element, geom2: Element) -> ContactMaterial:
        """Say what contacts between two geoms have, after combination and overrides.

        Any two geoms will do, also those that the model keeps from touching.

        Raises
        ------
        TypeError, ValueError
            If a geom is unknown, both are the same, the law is ``"comfree"``, the materials do not
            combine by :attr:`rules`, or the model's ``solref`` for the pair means nothing.

        Examples
        --------
        >>> engine.contact_material("box", "floor").source
        'rigid'
        """
        self._check_takes_materials()
        pair = self._geom_pair(geom1, geom2)
        found = _core.contact_material(self.model._address, self._parameters(), *pair)
        of_solref = found.pop("of_solref")
        source: Literal["pair", "geoms", "solref", "rigid"]
        if pair in self._pair_material:
            source = "pair"
        elif not self._geom_material.keys().isdisjoint(pair):
            source = "geoms"
        else:
            source = "solref" if of_solref else "rigid"
        return ContactMaterial(source=source, **found)

    def make_data(self) -> mujoco.MjData:
        """Make data for :attr:`model`, with empty contact memory.

        Examples
        --------
        >>> engine.make_data().qpos[:3]
        array([0. , 0. , 0.2])
        """
        return mujoco.MjData(self.model)

    def step(self, data: mujoco.MjData, nstep: int = 1) -> StepStats:
        """Advance ``data`` by ``nstep`` time steps of the model.

        Parameters
        ----------
        data
            Made by :meth:`make_data`. Controls and applied forces are read from it as by
            ``mj_step`` and held over all ``nstep`` steps.
        nstep
            Number of steps, >= 1.

        Returns
        -------
        StepStats
            Contacts, islands and sizes of the last step; maxima over all steps of micro-steps,
            clipped rows, penetration, compression and parts of a step. The number of cuts at
            impacts.

        Raises
        ------
        TypeError
            If ``data`` is no ``mujoco.MjData`` or ``nstep`` no integer.
        ValueError
            If ``nstep`` is below 1, state, controls or applied forces are not finite, or ``data``
            was made from another model or holds no contact memory in its user data. Data are
            untouched.
        DivergenceError
            A RuntimeError: if motion or contact forces diverge; data keep the state from before
            the failing step.
        RuntimeError
            If the engine is being stepped by this thread already, as by a callback within a step.
            If contacts exceed the memory, or rows do that sensors, plugins or flexes read. Data
            keep the state from before the failing step. Rows that nothing reads but
            :meth:`contacts` and ``mj_contactForce`` are left out where the memory of the model is
            too small for them; MuJoCo counts that in ``data.warning``. Fatal errors of MuJoCo come
            as RuntimeError too.

        What Python callbacks of MuJoCo raise passes through; data keep the state from before that
        step. Ctrl-C ends a call of many steps between two of them.

        Warns
        -----
        UserWarning
            If ``mj_step`` moved the data since the last call, or the model that the engine was made
            of was edited in place of :attr:`model`.

        Notes
        -----
        MuJoCo's own rows of contacts (``efc_*``, ``contact.efc_address``), from which
        ``mj_contactForce`` reads the mean forces over a step, are made in the last step of a call.
        In the steps before it, and in :func:`dashpot.rollout`, they are made only if the model has
        sensors, plugins or flexes, which read them. Rows of limits, equalities and dry friction are
        made in every step. Control and passive callbacks see no contacts and no rows, but sensors
        of positions and velocities, which are computed for them first. A sensor callback is asked
        twice for these then, as it may be where sensors of contacts need no forces. In these two
        stages it sees what detection found ahead, too.

        Examples
        --------
        >>> fresh = engine.make_data()
        >>> stats = engine.step(fresh, nstep=20)
        >>> round(fresh.time, 6), stats.clipped
        (0.1, 0)
        """
        self._check_data(data)
        steps = positive_count("nstep", nstep)
        self._calls += 1
        if self._calls == self._looks_at:
            self._looks_at *= 4  # ever more seldom: it takes as long as some steps
            if self._original is not None:
                self._original.warn_of_edits()
        built = self._built
        if built.stepper is None:
            built.stepper = _core.Stepper(
                self.model._address, self._lock, self._parameters(built), self.nthread
            )
        return built.stepper.step(data._address, steps)

    def contacts(
        self,
        data: mujoco.MjData,
        *,
        geom: Element | None = None,
        body: Element | None = None,
        pair: Sequence[Element] | None = None,
    ) -> Contacts:
        """Contacts of the last step of ``data``, all or those that every given filter passes.

        Forces are those of the last :meth:`step`, which ``data`` hold as MuJoCo's ``efc_force``:
        after ``mj_forward``, ``mj_step`` or ``mj_inverse`` on them they are MuJoCo's.

        Parameters
        ----------
        data
            Made by :meth:`make_data`.
        geom
            Name or id: contacts of that geom.
        body
            Name or id: contacts of that body's own geoms (not its children's).
        pair
            Two geoms by name or id, in either order: contacts between them.

        Raises
        ------
        ValueError
            If a geom or body is unknown, a pair has not two different geoms, or ``data`` was made
            from another model.
        RuntimeError
            If the last step did not end or left out MuJoCo's rows, which forces are read from,
            because the memory of the model (``<size memory="..."/>``) was too small for them.

        Examples
        --------
        >>> engine.contacts(data, pair=("floor", "ball")).force.round(2)
        array([[9.81, 0.  , 0.  ]])
        >>> len(engine.contacts(data, geom="box").force)
        4
        """
        self._check_data(data)
        arrays = _core.contacts(self.model._address, data._address, self._contact_capacity)
        if self._side_names is None:
            self._side_names = names_of_sides(self.model)
        side = np.where(arrays["geom"] >= 0, arrays["geom"], self.model.ngeom + arrays["flex"])
        found = Contacts(names=self._side_names[side], **arrays)
        return of_objects(found, self.model, geom, body, pair)

    def energy(self, data: mujoco.MjData) -> Energy:
        """Mechanical energy of the present state, and what contact has dissipated so far.

        Examples
        --------
        >>> round(engine.energy(data).kinetic, 6)
        0.0
        """
        self._check_data(data)
        if self._scratch is None:
            self._scratch = mujoco.MjData(self.model)
        model, scratch = self.model._address, self._scratch._address
        return Energy(**_core.energy(model, data._address, scratch, self._contact_capacity))

    def to_warp(self, nworld: int = 1, **options: Any) -> tuple[Any, Any]:
        """Return this engine's model and data of `nworld` worlds for `dashpot.warp`.

        Parameters
        ----------
        nworld
            Number of worlds.
        **options
            Of `dashpot.warp.make_data`: `nconmax`, `njmax`.

        Returns
        -------
        m, d
            For ``dashpot.warp.step(m, d)``, with the materials and options of the engine.

        Raises
        ------
        NotImplementedError
            Naming an option, or what of the model, ``dashpot.warp`` does not have.

        Examples
        --------
        >>> m, d = dashpot.Engine(model).to_warp(nworld=4)
        >>> d.qpos.shape
        (4, 14)
        """
        warp: Any = importlib.import_module("dashpot.warp")
        untaken = ("max_microsteps", "impact", "rules")
        for name, value in self._options.changed().items():
            if name in untaken:
                raise NotImplementedError(f"dashpot.warp has no {name}; this engine has {value!r}")
        given: dict[str, Any] = {
            name: getattr(self, name)
            for name in (
                "law",
                "microsteps",
                "recovery_speed",
                "comfree_stiffness",
                "comfree_damping",
                "mocap_timeconst",
            )
            if getattr(self, name) is not None
        }
        m = warp.put_model(
            self.model,
            materials=self.materials,
            pair_materials=self.pair_materials,
            **given,
        )
        return m, warp.make_data(self.model, nworld, **options)

    def report(self) -> Report:
        """Which MJCF options and features of the model are honoured, mapped or refused.

        The ``solref`` of geoms and pairs that materials take the place of is not among them.

        Examples
        --------
        >>> print(engine.report().features[-1].name)
        option cone
        """
        replaced = replaced_by_materials(
            self.model, tuple(self._geom_material), self._pair_material
        )
        rows = _core.features(self.model._address, _core.Law[self.law])
        return Report(tuple(Feature(*row) for row in rows if row[0] not in replaced))

    def __repr__(self) -> str:
        """Return law, time step (s), options other than the defaults, and numbers of materials."""
        threads = {} if self.nthread == 1 else {"nthread": self.nthread}
        options = {**self._options.changed(), **threads}
        shown = "".join(f"{name}={value!r}, " for name, value in options.items())
        return (
            f"Engine(law={self.law!r}, timestep={self.model.opt.timestep:g}, {shown}"
            f"geoms={self.model.ngeom}, materials={len(self._geom_material)}, "
            f"pair_materials={len(self._pair_material)})"
        )

    def __copy__(self) -> Engine:
        """Return an engine of its own: a copy of the model and the same options and materials."""
        other = type(self).__new__(type(self))
        other.__setstate__(self.__getstate__())
        return other

    def __getstate__(self) -> dict[str, Any]:
        """Return what copies and pickles hold, with a copy of the model."""
        with self._lock:  # during a step of another thread the model is not as its user left it
            model = copy.deepcopy(self.model)
        return {
            **getattr(self, "__dict__", {}),  # of a subclass without slots
            "_model": model,
            "_options": self._options,
            "_nthread": self._nthread,
            "_contact_capacity": self._contact_capacity,
            "_geom_material": dict(self._geom_material),
            "_pair_material": dict(self._pair_material),
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take a copied or pickled state."""
        for name, value in state.items():
            setattr(self, name, value)
        self._lock = new_lock()
        self._materials_changed()
        self._scratch = None
        self._side_names = None
        self._calls, self._looks_at = 0, 1
        self._original = None

    def _give(self, materials: Mapping[Any, Material | None]) -> None:
        """Give geoms their materials and say nothing."""
        self._put_in(self._geom_material, {self.geom_id(g): m for g, m in materials.items()})

    def _put_in(self, present: dict[_Key, Material], new: Mapping[_Key, Material | None]) -> None:
        """Put materials in their places, or take away those that are there."""
        for material in new.values():
            if not isinstance(material, Material | None):
                raise TypeError(
                    f"material is {type(material).__name__}; it must be a Material or None"
                )
        self._check_takes_materials()
        for key, material in new.items():
            if material is None:
                present.pop(key, None)
            else:
                present[key] = material
        self._materials_changed()

    def _warn_of_idle_friction(self, geoms: Iterable[Element]) -> None:
        """Warn what called a method that calls this of friction that has no effect."""
        warn_of_idle_friction(
            self.model,
            self._geom_material,
            self._pair_material,
            self._options.rules,
            map(self.geom_id, geoms),
            stack_level=3,
        )

    def _materials_changed(self) -> None:
        """Forget what was made of materials. Threads that make it still do so for nobody."""
        self._built = _Built()

    def _parameters(self, built: _Built | None = None) -> _core.Parameters:
        """Options and materials for the C++ core, kept until a material changes; not to be set."""
        built = built or self._built
        if built.parameters is not None:
            return built.parameters
        parameters = _core.Parameters()
        parameters.options = self._options.to_core()
        parameters.contact_capacity = self._contact_capacity
        geom_material = []
        for geom in range(self.model.ngeom):
            material = self._geom_material.get(geom, Material())._to_core()
            material.from_model = geom not in self._geom_material
            geom_material.append(material)
        parameters.geom_material = geom_material
        parameters.pair_material = {pair: m._to_core() for pair, m in self._pair_material.items()}
        built.parameters = parameters
        return parameters

    def _rollout_workers(self) -> _core.RolloutWorkers:
        """Workers that roll out the model, kept until a material changes."""
        built = self._built
        if built.rollouts is None:
            built.rollouts = _core.RolloutWorkers(
                self.model._address, self._lock, self._parameters(built)
            )
        return built.rollouts

    def _geom_pair(self, geom1: Element, geom2: Element) -> tuple[int, int]:
        """Ids of two different geoms, the lower first."""
        first = object_id(self.model, geom1, "geom", "geom1")
        second = object_id(self.model, geom2, "geom", "geom2")
        if first == second:
            raise ValueError(f"geoms {geom1!r} and {geom2!r} are the same geom")
        return min(first, second), max(first, second)

    def _check_takes_materials(self) -> None:
        if self.law == "comfree":
            raise ValueError(
                "law 'comfree' takes no materials; set geom_friction and geom_solimp in the model"
            )

    def _check_data(self, data: mujoco.MjData) -> None:
        if not is_data_of(self.model, data) or data.userdata.shape[0] != self.model.nuserdata:
            raise ValueError("data was made from another model; make it with Engine.make_data()")
