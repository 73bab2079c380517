#!/usr/bin/env python3
"""Compile the OpenCL programs for an NVIDIA GPU without one: .ci/gpu_registers.py [sm_80].

Prints registers, bytes of stack and of spills for each kernel, and the time of each program. Needs clang, and
ptxas of CUDA or of the wheel nvidia-cuda-nvcc-cu12. Exits with 1 where a kernel of MOST exceeds its registers
or has a stack. NVIDIA's driver has another front end, so its numbers differ a little.
"""

import re
import shutil
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

from sketchterrain.io import resources
from sketchterrain.look import texture_levels
from sketchterrain.schema.materials import BUILT_IN
from sketchterrain.terrain.materials import material_defines

MOST = {"patches": 128, "points": 128}  # 16 warps on a multiprocessor of 65,536 registers
KERNELS = Path(__file__).parents[1] / "kernels"
# Functions of OpenCL that the kernels call; clang only declares them.
FUNCTIONS = """
#define OVERLOADED __attribute__((overloadable, always_inline))
#define NVVM(name, d) \\
    (d == 0 ? __nvvm_read_ptx_sreg_##name##_x() \\
            : d == 1 ? __nvvm_read_ptx_sreg_##name##_y() : __nvvm_read_ptx_sreg_##name##_z())
size_t OVERLOADED get_group_id(uint d) { return NVVM(ctaid, d); }
size_t OVERLOADED get_local_id(uint d) { return NVVM(tid, d); }
size_t OVERLOADED get_global_id(uint d) { return NVVM(ctaid, d) * NVVM(ntid, d) + NVVM(tid, d); }
size_t OVERLOADED get_global_size(uint d) { return NVVM(nctaid, d) * NVVM(ntid, d); }
int OVERLOADED min(int a, int b) { return a < b ? a : b; }
long OVERLOADED clamp(long x, long a, long b) { return x < a ? a : x > b ? b : x; }
uint OVERLOADED mul_hi(uint a, uint b) { return (uint)((ulong)a * b >> 32); }
float OVERLOADED floor(float x) { return __builtin_floorf(x); }
double OVERLOADED floor(double x) { return __builtin_floor(x); }
float OVERLOADED rint(float x) { return __builtin_rintf(x); }
float OVERLOADED sin(float x) { return __nvvm_sin_approx_f(x); }
float OVERLOADED cos(float x) { return __nvvm_cos_approx_f(x); }
#define STORE(v, p) (p)[0] = v.s0, (p)[1] = v.s1, (p)[2] = v.s2, (p)[3] = v.s3
float4 OVERLOADED vload4(size_t i, const __global float *p)
{
    return (float4)(p[4 * i], p[4 * i + 1], p[4 * i + 2], p[4 * i + 3]);
}
void OVERLOADED vstore4(float4 v, size_t i, __global float *p) { STORE(v, p + 4 * i); }
void OVERLOADED vstore4(uint4 v, size_t i, __global uint *p) { STORE(v, p + 4 * i); }
int OVERLOADED atomic_add(volatile __global int *p, int v) { return __sync_fetch_and_add(p, v); }
"""
CLANG = ["clang", "-x", "cl", "-cl-std=CL1.2", "-target", "nvptx64-nvidia-nvcl", "-DREAL=float", "-O3", "-S"]
CLANG += ["-Xclang", "-finclude-default-header", "-Xclang", "-target-cpu", "-Xclang"]
FACTS = re.compile(r"function '(\w+)'.*?(\d+) bytes stack.*?(\d+) bytes spill.*?Used (\d+) reg", re.DOTALL)


def find_ptxas() -> str | None:
    """Return the path of ptxas, on the PATH or of NVIDIA's wheel."""
    wheel = find_spec("nvidia")
    folders = [] if wheel is None else wheel.submodule_search_locations or []
    paths = (Path(folder) / "cuda_nvcc/bin/ptxas" for folder in folders)
    return shutil.which("ptxas") or next((str(path) for path in paths if path.is_file()), None)


def compiled(file: str, ptxas: str, target: str) -> list[tuple[str, ...]]:
    """Return name, stack, spills (bytes) and registers of the kernels of a file."""
    defines = texture_levels.DEFINES if file == texture_levels.SOURCE else material_defines(BUILT_IN)
    text = f"{FUNCTIONS}#line 1\n{resources.source(file, defines)}"
    with TemporaryDirectory() as folder:
        clang = [*CLANG, target, "-o", f"{folder}/a.ptx", "-"]
        subprocess.run(clang, input=text.encode(), check=True, stderr=subprocess.DEVNULL)
        command = [ptxas, "-v", f"-arch={target}", "-o", f"{folder}/a.cubin", f"{folder}/a.ptx"]
        return FACTS.findall(subprocess.run(command, check=True, capture_output=True, text=True).stderr)


def main(target: str = "sm_80") -> int:
    """Print the table, and return 1 if a kernel exceeds its bounds, 2 without the compilers."""
    ptxas, exceeded = find_ptxas(), False
    if ptxas is None or shutil.which("clang") is None:
        print("needs clang and ptxas: apt install clang; pip install nvidia-cuda-nvcc-cu12")
        return 2
    for path in sorted(KERNELS.glob("*.cl")):
        start = time.perf_counter()
        for name, stack, spills, registers in compiled(path.name, ptxas, target):
            print(f"{path.name:22}{name:20}{registers:>4} registers{stack:>5} stack{spills:>5} spilled")
            exceeded |= name in MOST and (int(registers) > MOST[name] or int(stack) > 0)
        print(f"{path.name:22}{time.perf_counter() - start:.2f} s")
    return int(exceeded)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
