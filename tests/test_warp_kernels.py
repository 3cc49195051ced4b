"""What the micro-steps' kernel takes of a GPU, read off its machine code; no GPU is needed."""

import struct
from pathlib import Path

import pytest

from warp_worlds import wp

from dashpot.warp.microsteps import REGISTERS, run_microsteps  # isort: skip
from dashpot.warp.sweeps import sweep_kernel  # isort: skip

REGISTER_COUNT, FRAME_SIZE = 0x2F, 0x11  # attributes in .nv.info, each with a symbol and a number
PAIR = 4  # their format


def attributes(cubin: bytes) -> dict[int, list[int]]:
    """Numbers of `.nv.info` of an ELF, by attribute."""
    (table,) = struct.unpack_from("<Q", cubin, 0x28)
    size, count, names = struct.unpack_from("<HHH", cubin, 0x3A)
    sections = [struct.unpack_from("<IIQQQQIIQQ", cubin, table + i * size) for i in range(count)]
    found: dict[int, list[int]] = {}
    for section in sections:
        start = sections[names][4] + section[0]
        if cubin[start : cubin.index(b"\0", start)] != b".nv.info":
            continue
        at, end = section[4], section[4] + section[5]
        while at + 4 <= end:
            form, attribute, length = struct.unpack_from("<BBH", cubin, at)
            if form == PAIR:
                if attribute in (REGISTER_COUNT, FRAME_SIZE):
                    found.setdefault(attribute, []).append(
                        struct.unpack_from("<II", cubin, at + 4)[1]
                    )
                at += length
            at += 4
    return found


def machine_code(module, arch) -> bytes:
    """Compile a module, or take what an earlier run compiled of the same source."""
    name = f"{module.name}-{module.hash_module().hex()[:12]}-sm{arch}"
    directory = Path(wp.config.kernel_cache_dir) / "registers" / name
    if not any(directory.glob("*.cubin")):
        directory.mkdir(parents=True, exist_ok=True)
        try:
            wp.compile_aot_module(module, arch=arch, module_dir=directory, use_ptx=False)
        except Exception as error:
            if "NVRTC" in str(error) or "CUDA" in str(error):
                pytest.skip(f"Warp cannot compile for CUDA here: {error}")
            raise
    (path,) = directory.glob("*.cubin")
    return path.read_bytes()


@pytest.mark.parametrize(
    ("kernel", "arch"),
    [
        (run_microsteps, 80),
        (run_microsteps, 90),
        (run_microsteps, 120),
        (sweep_kernel(3), 90),
        (sweep_kernel(6), 90),
    ],
)
def test_a_kernel_fits_its_registers_without_a_stack(kernel, arch):
    found = attributes(machine_code(kernel.module, arch))
    assert max(found[REGISTER_COUNT]) <= REGISTERS
    assert max(found[FRAME_SIZE]) == 0
