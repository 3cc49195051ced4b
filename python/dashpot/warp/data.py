"""Data of many worlds on the device: MuJoCo Warp's, with the law's memory and flags."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import mujoco_warp
import numpy as np
import warp as wp
from numpy.typing import NDArray

from dashpot.warp.material import Pair
from dashpot.warp.memory import forget
from dashpot.warp.microsteps import DIMS
from dashpot.warp.model import LawModel, Model, _constraint_rows, _dims, _sides
from dashpot.warp.state import Memory, Rows, Work

__all__ = ["Data", "LawData", "get_data_into", "make_data", "put_data", "reset_data"]

# Up to so many groups of at most three rows a world couples them by blocks of A; else by trees.
MOST_BLOCKS = 64
# Lanes of a block, at most: with 168 registers each a multiprocessor has room for 384.
MOST_LANES = 256
# Arrays of the model that springs of a solref go by.
OF_MODEL = (
    "geom_bodyid",
    "site_bodyid",
    "jnt_dofadr",
    "eq_type",
    "eq_objtype",
    "eq_obj1id",
    "eq_obj2id",
    "body_invweight0",
    "dof_invweight0",
    "tendon_invweight0",
)


class LawData:
    """What the law keeps per world. Flags may be read at any time, they wait for the device.

    Attributes
    ----------
    groups
        How many contacts and constraint rows a world may have.
    """

    rows: Any
    memory: Any
    work: Any

    def __init__(self, mjm: mujoco.MjModel, d: Any, nconmax: int) -> None:
        dims, nworld = _dims(mjm), d.nworld
        self.groups = groups = max(1, nconmax + _constraint_rows(mjm))
        self.by_trees = groups > MOST_BLOCKS or dims > DIMS
        self.block = _block(groups, self.by_trees)
        self.nconmax = nconmax
        self.device = d.qpos.device
        nv, nq = max(1, mjm.nv), max(1, mjm.nq)
        sizes = mjm.tree_dofnum.astype(np.int64)
        ntree, width = max(1, mjm.ntree), int(max([1, *sizes]))
        sides = _sides(mjm)
        slots = dims * sides * width
        blocks = 1 if self.by_trees else groups
        special = {
            "count": (nworld,),
            "steps": (nworld,),
            "tree": (nworld, sides, groups),
            "members": (nworld, groups * sides),
            "J": (nworld, slots, groups),
            "Y": (nworld, slots, groups),
            "A": (nworld, blocks * dims, dims, blocks),
            "own_bound": (nworld, 3, groups),
            "e": (nworld, 4 * dims, groups),
            "qpos": (nworld, nq),
            "rest": (nworld, nq),
            "qvel": (nworld, nv),
            "poses": (nworld, 7 * max(1, mjm.nmocap)),
            "behind": (nworld, 12 * max(1, mjm.nmocap)),
            "start": (nworld, nv),
            "force": (nworld, nv),
            "a": (nworld, nv),
            "L": (nworld, max(1, int((sizes**2).sum()))),
            "H": (nworld, max(1, mjm.nC)),
            "displacement": (nworld, nv),
            "end": (nworld, nv),
            "edited": (nworld, ntree),
            "first": (nworld, ntree + 1),
            "tree_force": (nworld, ntree * width),
            "tree_impulse": (nworld, ntree * width),
            "twist": (nworld, mjm.nbody),
            "blow": (nworld, mjm.nbody),
            "z": (nworld, 6, dims, groups),
            "bound": (nworld, 3),
            "clipped": (nworld,),
            "overflow": (nworld,),
            "diverged": (nworld,),
        }

        def make(struct: Any, *, is_work: bool = False) -> Any:
            instance = struct()
            for name, kind in _fields(struct).items():
                if kind is int:
                    continue
                shape = special.get(name)
                if shape is None or len(shape) != kind.ndim or (name == "force" and not is_work):
                    shape = (nworld, dims, groups) if kind.ndim == 3 else (nworld, groups)
                if name == "bound" and not is_work:
                    shape = (nworld, 3, groups)
                setattr(instance, name, wp.zeros(shape, dtype=kind.dtype, device=self.device))
            return instance

        self.rows = make(Rows)
        self.rows.dims, self.rows.sides, self.rows.width = dims, sides, width
        self.memory = make(Memory)
        self.work = make(Work, is_work=True)
        self.geom_speed = wp.zeros((nworld, max(1, mjm.ngeom)), dtype=wp.float32)
        self.geom_margin = wp.zeros((nworld, max(1, mjm.ngeom)), dtype=wp.float32)
        self.pair_margin = wp.zeros((nworld, max(1, mjm.npair)), dtype=wp.float32)
        self.jnt_margin = wp.zeros((nworld, max(1, mjm.njnt)), dtype=wp.float32)
        self.tendon_margin = wp.zeros((nworld, max(1, mjm.ntendon)), dtype=wp.float32)
        self.contact_margin = wp.zeros(max(1, d.naconmax), dtype=wp.float32)
        self.middle = wp.zeros((nworld, nq), dtype=wp.float32)
        self.bias = wp.zeros((nworld, nv), dtype=wp.float32)
        self.mocap_told = wp.zeros((nworld, 7 * max(1, mjm.nmocap)), dtype=wp.float32)
        self.mocap_behind = wp.zeros((nworld, 12 * max(1, mjm.nmocap)), dtype=wp.float32)
        self.mocap_motion = wp.zeros((nworld, max(1, mjm.nmocap)), dtype=wp.spatial_vector)
        # What `forward` would remember: nobody reads it.
        self.aside = make(Memory) if mjm.nmocap else self.memory
        self.no_body = wp.zeros(mjm.nbody, dtype=wp.int32)
        self._pair: Any = None
        self._pair_of: Any = None

    @property
    def bound(self) -> wp.array:
        """(nworld, 3) largest bounds: of stiffness, of damping of normals and of friction."""
        return self.work.bound

    @property
    def clipped(self) -> wp.array:
        """(nworld,) rows whose given stiffness or damping was lowered, over all steps."""
        return self.work.clipped

    @property
    def overflow(self) -> wp.array:
        """(nworld,) 1 where a world had more contacts or rows than fit."""
        return self.work.overflow

    @property
    def diverged(self) -> wp.array:
        """(nworld,) 1 where a world lost its numbers. It harms no other."""
        return self.work.diverged

    def pair(self, m: Model, d: Any) -> Any:
        """Materials and solrefs for kernels, kept until an array is replaced."""
        law: LawModel = m.dashpot
        key = (id(law.stiffness), id(law.damping), id(m), id(d.contact.solref))
        if self._pair_of != key:
            pair = Pair()
            for name in (
                "stiffness",
                "damping",
                "form",
                "tangential_ratio",
                "tangential_damping",
                "pair_geoms",
                "pair_values",
            ):
                setattr(pair, name, getattr(law, name))
            pair.contact_solref, pair.contact_solimp = d.contact.solref, d.contact.solimp
            pair.own_solref = law.own[0]
            for name in OF_MODEL:
                setattr(pair, name, getattr(m, name))
            pair.own0, pair.own1, pair.own2, pair.own3, pair.own4 = law.own[1:]
            pair.solref0, pair.solimp0 = m.eq_solref, m.eq_solimp
            pair.solref1, pair.solimp1 = m.dof_solref, m.dof_solimp
            pair.solref2, pair.solimp2 = m.tendon_solref_fri, m.tendon_solimp_fri
            pair.solref3, pair.solimp3 = m.jnt_solref, m.jnt_solimp
            pair.solref4, pair.solimp4 = m.tendon_solref_lim, m.tendon_solimp_lim
            self._pair, self._pair_of = pair, key
        return self._pair


class Data(mujoco_warp.Data):  # type: ignore[misc]
    """MuJoCo Warp's data with the law's part of it, `dashpot`.

    Examples
    --------
    >>> d.nworld, type(d.dashpot).__name__
    (4, 'LawData')
    """

    dashpot: LawData


def _fields(struct: Any) -> dict[str, Any]:
    """Return the arrays of a Warp struct by name."""
    fields: dict[str, Any] = struct.cls.__annotations__
    return fields


def _block(groups: int, by_trees: bool) -> int:
    """Lanes of a block: powers of two on the CPU device, whole warps on a GPU."""
    if wp.get_device().is_cpu:
        # Lanes take turns there: fewer are faster, where they sweep.
        return 8 if by_trees else max(8, 1 << (groups - 1).bit_length())
    return int(min(MOST_LANES, 32 * ((groups + 31) // 32)))


def _sizes(mjm: mujoco.MjModel, nconmax: int | None, njmax: int | None) -> tuple[int, int]:
    """Capacities of a world: what MuJoCo Warp guesses, with room for what comes near."""
    if nconmax is None:
        nconmax = 48
    least = nconmax * _dims(mjm) + _constraint_rows(mjm)
    return nconmax, max(least, njmax or 0)


def make_data(
    mjm: mujoco.MjModel,
    nworld: int = 1,
    nconmax: int | None = None,
    njmax: int | None = None,
    **options: Any,
) -> Data:
    """Make data of `nworld` worlds at the model's reference positions.

    Parameters
    ----------
    mjm
        The model that `put_model` was given.
    nworld
        Number of worlds.
    nconmax
        Contacts that a world may have, those that come near within a step included; 48 by default.
        What does not fit is left out, and flagged in ``d.dashpot.overflow``.
    njmax
        As in ``mujoco_warp.make_data``; at least what `nconmax` contacts need.
    **options
        Others of ``mujoco_warp.make_data``.

    Examples
    --------
    >>> d = dw.make_data(model, nworld=8, nconmax=16)
    >>> d.qpos.shape
    (8, 14)
    """
    nconmax, njmax = _sizes(mjm, nconmax, njmax)
    d = mujoco_warp.make_data(mjm, nworld, nconmax=nconmax, njmax=njmax, **options)
    return _with_memory(mjm, d, nconmax)


def put_data(
    mjm: mujoco.MjModel,
    mjd: mujoco.MjData,
    nworld: int = 1,
    nconmax: int | None = None,
    njmax: int | None = None,
    memory: Mapping[str, NDArray[Any]] | None = None,
    **options: Any,
) -> Data:
    """Put data on the device, the same in all worlds; parameters as in `make_data`.

    `memory` is what `get_data_into` returned, for the same `nconmax`.

    Examples
    --------
    >>> d = dw.put_data(model, mujoco.MjData(model), nworld=2)
    >>> d.qpos.numpy()[1, :3].round(2)
    array([0. , 0. , 0.2], dtype=float32)
    """
    nconmax, njmax = _sizes(mjm, nconmax, njmax)
    nconmax, njmax = max(nconmax, mjd.ncon), max(njmax, mjd.nefc)
    d = mujoco_warp.put_data(mjm, mjd, nworld, nconmax=nconmax, njmax=njmax, **options)
    d = _with_memory(mjm, d, nconmax)
    for name, values in (memory or {}).items():
        array = getattr(d.dashpot.memory, name)
        if np.shape(values) != np.shape(array.numpy())[1:]:
            raise ValueError(f"memory is that of another model or nconmax: {name!r} does not fit")
        array.assign(np.broadcast_to(values, (nworld, *np.shape(values))))
    return d


def _with_memory(mjm: mujoco.MjModel, d: Any, nconmax: int) -> Data:
    d.__class__ = Data
    d.dashpot = LawData(mjm, d, nconmax)
    result: Data = d
    return result


def get_data_into(
    result: mujoco.MjData, mjm: mujoco.MjModel, d: Data, world_id: int = 0
) -> dict[str, NDArray[Any]]:
    """Copy one world into MuJoCo's data, as ``mujoco_warp.get_data_into`` does.

    Returns
    -------
    memory
        What its contacts remember, which MuJoCo's data have no place for. With it `put_data` goes
        on as if nothing had been copied; without it contacts begin anew.

    Examples
    --------
    >>> one = mujoco.MjData(model)
    >>> memory = dw.get_data_into(one, model, d, world_id=0)
    >>> one.qpos.shape
    (14,)
    """
    mujoco_warp.get_data_into(result, mjm, d, world_id)
    memory = d.dashpot.memory
    names = _fields(Memory)
    return {name: getattr(memory, name).numpy()[world_id].copy() for name in names}


def reset_data(m: Model, d: Data, reset: wp.array | None = None) -> None:
    """Reset worlds to the model's reference positions and clear what contacts remember.

    Parameters
    ----------
    m, d
        Model and data.
    reset
        (nworld,) bool array of the worlds to reset; all of them without it.

    Examples
    --------
    >>> mask = wp.array([True, False, False, False], dtype=bool)
    >>> dw.reset_data(m, d, reset=mask)
    """
    mujoco_warp.reset_data(m, d, reset)
    mask = reset if reset is not None else wp.zeros(1, dtype=wp.bool)
    wp.launch(
        forget,
        dim=d.nworld,
        inputs=[mask, reset is not None, m.nq, d.dashpot.memory, d.dashpot.work],
    )
