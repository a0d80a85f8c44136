"""AniGen: rigged assets from images and meshes, without PyTorch for Python.

    import anigen
    fox, how = anigen.rig(anigen.load("fox.obj"))
    anigen.save(anigen.animate(fox, ["walk"]), "fox.glb")
    anigen.evaluate(anigen.load("theirs.glb"), anigen.load("truth.glb"))["j2j"]

Long calls take `progress=function(stage, fraction)`; it cancels the call by returning False, which raises
`Interrupted`, or by an exception, which reaches the caller. Errors are `InputError` (a ValueError that names file and
place), `Error` and `Interrupted`.
"""

import os
import sys


def _name_openblas_core():
    """Has OpenBLAS use the widest kernels for matrix products that the processor runs: it goes by the model number, and
    takes newer processors for old ones (anigen/core/openblas.h). It reads this when it is loaded: with the library below,
    or with numpy, if that was imported before."""
    try:
        with open("/proc/cpuinfo", encoding="ascii", errors="replace") as file:
            first = dict(line.split(":", 1) for line in file.read().split("\n\n")[0].splitlines() if ":" in line)
    except OSError:
        return
    values = {name.strip(): value.split() for name, value in first.items()}
    flags = set(values.get("flags", []))
    if not {"avx2", "fma"} <= flags:
        return
    wide = {"avx512f", "avx512cd", "avx512bw", "avx512dq", "avx512vl"} <= flags
    core = "SkylakeX" if wide else "Zen" if "AuthenticAMD" in values.get("vendor_id", []) else "Haswell"
    os.environ.setdefault("OPENBLAS_CORETYPE", core)


if "numpy" not in sys.modules:
    _name_openblas_core()

from ._anigen import (Asset, Error, Generated, Generator, InputError, Interrupted, animate, chamfer, evaluate,  # noqa: E402
                      from_arrays, gromov_wasserstein, lint, load, load_bytes, motion_words, motions_of, prepare, render, rig,
                      save, save_bytes, template_words, wasserstein)

__all__ = ["Asset", "Error", "Generated", "Generator", "InputError", "Interrupted", "animate", "chamfer", "evaluate",
           "from_arrays", "gromov_wasserstein", "lint", "load", "load_bytes", "motion_words", "motions_of", "prepare", "render", "rig", "save",
           "save_bytes", "template_words", "to_torch", "wasserstein"]


def to_torch(asset):
    """Arrays of an asset as tensors: {"vertices": float32 [V, 3], "faces": int32 [F, 3], "joints": float64 [J, 3],
    "parents": int32 [J], "skin": float32 [V, J]}. Vertices, faces and parents share the asset's memory.

    @raises Error: without PyTorch for Python (Debian: python3-torch)."""
    try:
        import torch
    except ImportError as error:
        raise Error("to_torch() needs PyTorch for Python, which cannot be imported (Debian: python3-torch): "
                    f"{error}") from error
    return {name: torch.from_numpy(getattr(asset, name)) for name in ("vertices", "faces", "joints", "parents", "skin")}
