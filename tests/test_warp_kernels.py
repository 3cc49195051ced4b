"""What the micro-steps' kernel takes of a GPU, read off its machine code; no GPU is needed."""

import struct

import pytest

from warp_worlds import wp

from dashpot.warp.microsteps import REGISTERS, microstep_kernel  # isort: skip

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


@pytest.mark.parametrize("arch", [80, 90, 120])
def test_the_kernel_fits_its_registers_without_a_stack(arch, tmp_path):
    module = microstep_kernel(3).module
    try:
        paths = wp.compile_aot_module(module, arch=arch, module_dir=tmp_path, use_ptx=False)
    except Exception as error:
        if "NVRTC" in str(error) or "CUDA" in str(error):
            pytest.skip(f"Warp cannot compile for CUDA here: {error}")
        raise
    (cubin,) = [path for path in paths if path.suffix == ".cubin"]
    found = attributes(cubin.read_bytes())
    assert max(found[REGISTER_COUNT]) <= REGISTERS
    assert max(found[FRAME_SIZE]) == 0
