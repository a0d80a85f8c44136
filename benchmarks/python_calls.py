#!/usr/bin/env python3
"""Cost of calls from Python beside the same ones from C++: median seconds and their ratio.

    python_calls.py BUILD ASSET.glb"""
import pathlib
import statistics
import subprocess
import sys
import time

build, file = pathlib.Path(sys.argv[1]), sys.argv[2]
sys.path.insert(0, str(build / "python"))
import anigen  # noqa: E402


def seconds_of(call):
    call()
    seconds = []
    for _ in range(9):
        started = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - started)
    return statistics.median(seconds)


asset = anigen.load(file)
joints, parents = asset.joints, list(asset.parents)
calls = {
    "rig": lambda: anigen.rig(asset, method="heat"),
    "gromov_wasserstein": lambda: anigen.gromov_wasserstein(joints, parents, joints, parents),
    "evaluate": lambda: anigen.evaluate(asset, asset, metrics=["skeleton", "transport", "skin"], registration=False),
}
said = subprocess.run([build / "benchmarks/benchmark_engine_calls", file], capture_output=True, text=True, check=True)
native = {name: float(seconds) for name, seconds in map(str.split, said.stdout.splitlines())}
print(f"{len(asset.vertices)} vertices, {len(joints)} joints")
print("| call | C++, ms | Python, ms | ratio |\n|---|--:|--:|--:|")
for name, call in calls.items():
    here = seconds_of(call)
    print(f"| {name} | {1e3 * native[name]:.2f} | {1e3 * here:.2f} | {here / native[name]:.2f} |")
