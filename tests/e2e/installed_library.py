#!/usr/bin/env python3
"""`cmake --install` gives programs, library and Python package that work from another prefix.

    installed_library.py BUILD SOURCE

Builds examples/library against the installed copy by find_package and by pkg-config, and runs what comes of it."""
import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import urllib.request

build, source = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])


def run(*words, **options):
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True, **options)
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(map(str, words))}\n{done.stdout}\n{done.stderr}")
    return done.stdout


def includes_only_public_headers(include):
    headers = list((include / "anigen").rglob("*.h"))
    assert headers
    for header in headers:
        for line in header.read_text().splitlines():
            words = line.split()
            if words[:1] != ["#include"]:
                continue
            name = words[1].strip('"<>')
            assert not name.startswith(("torch", "nlohmann", "spdlog", "opencv")), f"{header}: {line}"
            if name.startswith("anigen/"):
                assert (include / name).is_file(), f"{header} includes {name}, which is not installed"


with tempfile.TemporaryDirectory() as folder:
    prefix, work = pathlib.Path(folder) / "prefix", pathlib.Path(folder) / "work"
    work.mkdir()
    run("cmake", "--install", build, "--prefix", prefix)
    includes_only_public_headers(prefix / "include")
    environment = {name: value for name, value in os.environ.items() if name != "ANIGEN_WEIGHTS"}

    run("cmake", "-S", source / "examples/library", "-B", work / "examples", "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Debug",
        f"-DCMAKE_PREFIX_PATH={prefix}")
    run("cmake", "--build", work / "examples")
    mesh = work / "box.obj"
    corners = [(x, y, z) for z in range(9) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
    lines = [f"v {x} {z} {y}" for x, y, z in corners]
    lines += [f"f {4 * z + k + 1} {4 * z + (k + 1) % 4 + 1} {4 * z + (k + 1) % 4 + 5} {4 * z + k + 5}"
              for z in range(8) for k in range(4)] + ["f 4 3 2 1", "f 33 34 35 36"]
    mesh.write_text("\n".join(lines) + "\n")
    said = run(work / "examples/rig_and_animate", mesh, work / "box.glb", env=environment)
    assert " joints: " in said and (work / "box.glb").read_bytes()[:4] == b"glTF"
    said = run(prefix / "bin/anigen-eval", "--pred", work / "box.glb", "--dataset", work / "box.glb", "--output",
               work / "scores", "--no-report", env=environment)
    assert "j2j" in said.lower(), said
    run(prefix / "bin/anigen-rig", mesh, "-o", work / "rigged.glb", "--method", "curve", env=environment)

    if shutil.which("pkg-config"):
        paths = ":".join(str(path) for path in (prefix / "lib").rglob("pkgconfig"))
        flags = run("pkg-config", "--cflags", "--libs", "anigen", env={**environment, "PKG_CONFIG_PATH": paths}).split()
        run("c++", source / "examples/library/rig_and_animate.cpp", *flags, "-o", work / "by_pkg_config")

    image = source / "examples/creatures/deer.png"
    if (work / "examples/image_to_rig").exists() and (prefix / "share/anigen/weights/anigen-small").is_dir():
        run(work / "examples/image_to_rig", image, env=environment, cwd=work)
        assert (work / "deer.glb").read_bytes()[:4] == b"glTF"

    studio = prefix / "bin/anigen-studio"
    if studio.exists() and (prefix / "share/anigen/studio/first_job").is_dir():
        with subprocess.Popen([studio, "--output", work / "jobs"], stdout=subprocess.PIPE, text=True, env=environment) as page:
            address = page.stdout.readline().strip()
            with urllib.request.urlopen(address + "v1/jobs") as answer:
                first = json.load(answer)["jobs"][0]
            page.send_signal(signal.SIGINT)
        assert (first["state"], first["name"]) == ("done", "deer.png"), first
        assert (work / "jobs/jobs" / first["id"] / "rigged.glb").read_bytes()[:4] == b"glTF"

    packages = prefix / "lib/python3/dist-packages"
    if packages.is_dir():
        said = run("/usr/bin/python3", "-c",
                   f"import sys; sys.path.insert(0, '{packages}'); import anigen; "
                   f"asset, how = anigen.rig(anigen.load('{mesh}')); print(how, len(asset.joints))", env=environment)
        assert said.strip(), said
        if (prefix / "share/anigen/weights/anigen-small").is_dir():
            run("/usr/bin/python3", "-c", f"import sys; sys.path.insert(0, '{packages}'); import anigen; "
                f"print(anigen.Generator().generate('{image}'))", env=environment)
print("the installed copy works")
