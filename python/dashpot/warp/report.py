"""Mean forces of a step, where MuJoCo Warp's sensors and users read them."""

import warp as wp

from dashpot.warp.rows import efc_row
from dashpot.warp.state import Rows

wp.set_module_options({"enable_backward": False})


@wp.kernel
def report_forces(
    timestep: wp.array(dtype=wp.float32),
    contact_address: wp.array2d(dtype=wp.int32),
    rows: Rows,
    efc_force: wp.array2d(dtype=wp.float32),
):
    """``efc.force``; thread per group."""
    world, g = wp.tid()
    if g >= rows.count[world]:
        return
    T = timestep[world % timestep.shape[0]]
    source = rows.source[world, g]
    for i in range(rows.dim[world, g]):
        row = efc_row(source, i, contact_address)
        efc_force[world, row] = rows.total[world, i, g] / T
