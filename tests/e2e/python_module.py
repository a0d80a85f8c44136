#!/usr/bin/env python3
"""The Python package as people use it: files, arrays, rigging, motions, metrics, errors, progress, threads.

    python_module.py PACKAGES SOURCE [WEIGHTS]

PACKAGES is the folder that holds `anigen`. With WEIGHTS an image becomes a rigged asset, too."""
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import threading
import time

packages, source = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
sys.path.insert(0, str(packages))
import numpy as np  # noqa: E402

import anigen  # noqa: E402


def raises(kind, words, action):
    try:
        action()
    except kind as error:
        assert words in str(error), f"{error} does not say {words}"
        return
    raise AssertionError(f"{kind.__name__} expected")


def tube(rings=24, sides=12):
    """A capped tube along Z, closed."""
    angle = np.arange(sides) / sides * 2 * np.pi
    vertices = [(0.1 * np.cos(a), 0.1 * np.sin(a), z) for z in np.linspace(-0.5, 0.5, rings) for a in angle]
    faces = []
    for ring in range(rings - 1):
        for k in range(sides):
            a, b = ring * sides + k, ring * sides + (k + 1) % sides
            faces += [(a, b, b + sides), (a, b + sides, a + sides)]
    for k in range(1, sides - 1):
        faces.append((0, k + 1, k))
        top = (rings - 1) * sides
        faces.append((top, top + k, top + k + 1))
    return np.array(vertices, np.float32), np.array(faces, np.int32)


def check_openblas(packages):
    """A fresh interpreter names OpenBLAS the kernels that the programs name it."""
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_CORETYPE"}
    program = packages.parent / "bin" / "anigen-inspect"
    said = subprocess.run([program, "--version"], env=environment, capture_output=True, text=True, check=True).stdout
    wanted = re.search(r"OpenBLAS core (\w+)$", said, re.MULTILINE)
    code = f"import os, sys; sys.path.insert(0, {str(packages)!r}); import anigen; print(os.environ.get('OPENBLAS_CORETYPE'))"
    named = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True).stdout
    assert named.strip() == (wanted.group(1) if wanted else "None"), f"{named} is not that of {said}"


def check_arrays():
    vertices, faces = tube()
    joints = np.array([[0, 0, -0.4], [0, 0, 0], [0, 0, 0.4]])
    near = np.abs(vertices[:, 2:3] - joints[:, 2]) < 0.21
    skin = (near / near.sum(1, keepdims=True)).astype(np.float32)
    asset = anigen.from_arrays(vertices, faces, joints, [-1, 0, 1], skin, ["root", "middle", "tip"])
    assert np.array_equal(asset.vertices, vertices) and np.array_equal(asset.faces, faces)
    assert np.allclose(asset.joints, joints) and list(asset.parents) == [-1, 0, 1]
    assert np.allclose(asset.skin, skin, atol=1e-6) and asset.joint_names == ["root", "middle", "tip"]
    # A view: it outlives the name, and what is written to it is the asset's.
    view = asset.vertices
    view[0, 0] = 0.125
    assert asset.vertices[0, 0] == 0.125
    del asset
    assert view[0, 0] == 0.125
    raises(anigen.InputError, "expected (any, 3)", lambda: anigen.from_arrays(vertices.ravel(), faces))
    raises(ValueError, "", lambda: anigen.from_arrays(vertices, faces + 10_000))
    raises(anigen.InputError, "rows for", lambda: anigen.from_arrays(vertices, faces, joints, [-1, 0, 1], skin[:5]))
    raises(anigen.InputError, "joint", lambda: anigen.from_arrays(vertices, faces, joints, [1, 2, 0]))
    nan = vertices.copy()
    nan[3] = np.nan
    raises(anigen.InputError, "finite", lambda: anigen.from_arrays(nan, faces))
    for names in (["a"], ["a", "b", "c", "d"]):
        raises(anigen.InputError, f"names: has {len(names)} for 3 joints",
               lambda: anigen.from_arrays(vertices, faces, joints, [-1, 0, 1], skin, names))


def check_numbers():
    """No number is changed on its way into an asset: what does not fit is refused, with the argument's name."""
    vertices, faces = tube()
    joints, parents = np.array([[0, 0, -0.4], [0, 0, 0.4]]), [-1, 0]
    skin = np.full((len(vertices), 2), 0.5, np.float32)

    def refuses(words, vertices=vertices, faces=faces, joints=joints, parents=parents, skin=skin):
        raises(anigen.InputError, words, lambda: anigen.from_arrays(vertices, faces, joints, parents, skin))

    for like in (faces.tolist(), faces.astype(np.uint16), faces.astype(">i8"), np.asfortranarray(faces)):
        assert np.array_equal(anigen.from_arrays(vertices, like).faces, faces)
    assert len(anigen.from_arrays(vertices, np.zeros((0, 3))).faces) == 0
    wide, natural = faces.astype(np.int64), faces.astype(np.uint64)
    wide[5, 1] += 2**32
    natural[2, 0] = 2**64 - 1
    refuses(f"faces: row 5 has {wide[5, 1]}", faces=wide)
    refuses("faces: row 2 has 18446744073709551615", faces=natural)
    refuses("faces: has elements of type float64, expected integers", faces=faces + 0.9)
    refuses("faces: has elements of type bool", faces=faces > 3)
    refuses("parents: row 1 has 4294967296", parents=[-1, 2**32])
    refuses("parents: has elements of type float32", parents=np.array([-1, 0.9], np.float32))
    refuses("parents: has 2 dimensions", parents=[[-1, 0]])
    refuses("vertices: has elements of type complex", vertices=vertices + 1j)
    refuses("joints: has elements of type complex128, expected real numbers", joints=joints + 1j)
    refuses("skin: has elements of type complex", skin=skin + 1j)
    for value in (np.nan, np.inf, -1.0):
        bad = skin.copy()
        bad[[7, 9], 1] = value
        refuses("skin: row 7 has a weight that is below 0 or not finite", skin=bad)
    unbound = skin.copy()
    unbound[[7, 9]] = 0
    assert np.array_equal(anigen.from_arrays(vertices, faces, joints, parents, unbound).skin[7], [1, 0]), "the root"
    whole = np.zeros(skin.shape, bool)
    whole[:, 1] = True
    assert np.array_equal(anigen.from_arrays(vertices, faces, joints, parents, whole).skin, whole)
    for distance in (anigen.gromov_wasserstein, anigen.wasserstein, anigen.chamfer):
        raises(anigen.InputError, "joints_b: has elements", lambda: distance(joints, parents, joints + 1j, parents))
        raises(anigen.InputError, "parents_a: row 1", lambda: distance(joints, [-1, 2**32], joints, parents))


def check_none(folder, rigged):
    """None in place of an asset, as Generated.asset is after stop_at="voxels"."""
    for action in (lambda: anigen.save(None, folder / "none.glb"), lambda: anigen.save_bytes(None),
                   lambda: anigen.rig(None), lambda: anigen.animate(None), lambda: anigen.motions_of(None),
                   lambda: anigen.evaluate(None, rigged), lambda: anigen.evaluate(rigged, None),
                   lambda: anigen.evaluate(predicted=rigged, truth=None), lambda: anigen.lint(None),
                   lambda: anigen.render(None), lambda: anigen.prepare(None), lambda: anigen.prepare(asset=None)):
        raises(TypeError, "incompatible function arguments", action)


def check_files(folder):
    mesh = anigen.from_arrays(*tube())
    rigged, how = anigen.rig(mesh, method="curve", joints=6)
    assert rigged.joints.shape == (6, 3) and rigged.skin.shape == (len(mesh.vertices), 6), how
    assert np.allclose(rigged.skin.sum(1), 1, atol=1e-5)
    for name in ("a.glb", "a.gltf", "a.fbx", "a.usdz"):
        anigen.save(rigged, folder / name)
        assert (folder / name).stat().st_size > 1000
    again = anigen.load(folder / "a.glb")
    assert np.allclose(again.joints, rigged.joints, atol=1e-5)
    data = anigen.save_bytes(rigged)
    assert data[:4] == b"glTF" and np.allclose(anigen.load_bytes(data, "b.glb").joints, rigged.joints, atol=1e-5)
    raises(anigen.InputError, "cut.glb", lambda: anigen.load_bytes(data[:300], "cut.glb"))
    raises(anigen.InputError, "missing.glb", lambda: anigen.load(folder / "missing.glb"))
    moved = anigen.animate(rigged, ["idle"])
    assert len(moved.clips) == 1 and moved.clips[0][1] > 0.1 and not rigged.clips
    raises(anigen.InputError, "moonwalk", lambda: anigen.animate(rigged, ["moonwalk"]))
    picture = anigen.render(rigged, width=64, height=48, skeleton=True)
    assert picture.shape == (48, 64, 4) and picture.dtype == np.uint8 and picture[..., :3].std() > 1
    assert isinstance(anigen.lint(rigged), list)
    anigen.save(rigged, folder / "linted.glb")
    keys = {"code", "severity", "sentence", "count", "share"}
    assert all(keys <= set(found) for found in anigen.lint(folder / "linted.glb"))
    raises(anigen.InputError, "missing.glb", lambda: anigen.lint(str(folder / "missing.glb")))
    return rigged


def check_measures(rigged):
    same = anigen.evaluate(rigged, rigged, metrics=["skeleton", "skin"], normalization="truth", registration=False)
    assert same["j2j"] < 1e-9 and same["skin_l1"] < 1e-6, same
    joints, parents = rigged.joints, list(rigged.parents)
    assert anigen.gromov_wasserstein(joints, parents, joints + 1.0, parents) < 1e-6
    assert abs(anigen.wasserstein(joints, parents, joints + [0.1, 0, 0], parents) - 0.1) < 1e-9
    assert anigen.chamfer(joints, parents, joints, parents)["j2b"] < 1e-9
    raises(anigen.InputError, "", lambda: anigen.gromov_wasserstein(joints, [1, 0], joints, parents))


def check_jobs(rigged):
    heard = []
    anigen.rig(rigged, keep_skeleton=False, method="curve", progress=lambda *what: heard.append(what))
    assert heard and all(0 <= fraction <= 1 for _, fraction in heard)
    raises(anigen.Interrupted, "cancelled", lambda: anigen.rig(rigged, progress=lambda *_: False))
    calls = [lambda progress: anigen.rig(rigged, progress=progress),
             lambda progress: anigen.evaluate(rigged, rigged, metrics=["skeleton"], progress=progress)]

    def interrupted_by_user(*_):
        raise KeyboardInterrupt("by the user")

    for call in calls:
        raises(ZeroDivisionError, "division", lambda: call(lambda *_: 1 / 0))
        raises(KeyboardInterrupt, "by the user", lambda: call(interrupted_by_user))
        # In the last call, too, where nothing is left to end.
        raises(ZeroDivisionError, "division", lambda: call(lambda _, fraction: 1 / (1 - fraction)))
        raises(anigen.Interrupted, "cancelled", lambda: call(lambda _, fraction: fraction < 1))
        raises(TypeError, "incompatible function arguments", lambda: call(3))
        call(None)
    # Once it has ended the call, the function hears no more.
    heard.clear()
    raises(anigen.Interrupted, "cancelled", lambda: calls[0](lambda *what: heard.append(what) or False))
    assert len(heard) == 1, heard
    # The lock is free during long calls: another thread goes on meanwhile.
    counts = [0]
    done = threading.Event()

    def count():
        while not done.is_set():
            counts[0] += 1
            time.sleep(0.001)

    other = threading.Thread(target=count)
    other.start()
    start = time.time()
    while time.time() - start < 0.3:
        anigen.evaluate(rigged, rigged, metrics=["surface"])
    done.set()
    other.join()
    assert counts[0] > 20, counts


def check_preparation(folder, rigged):
    one = anigen.prepare(rigged, resolution=32)
    assert one["voxels"].shape[1] == 3 and one["voxels"].dtype == np.int32 and 0 <= one["voxels"].min()
    assert one["voxels"].max() < 32 and len(one["skeleton_voxels"]) > 3 and isinstance(one["usable"], bool)
    assert np.allclose(one["asset"].vertices, one["scale"] * rigged.vertices + one["offset"], atol=1e-5)
    assert abs(np.ptp(one["asset"].vertices, axis=0).max() - 1) < 1e-5
    raises(anigen.InputError, "soap", lambda: anigen.prepare(rigged, cleaning="soap"))
    raises(anigen.InputError, "", lambda: anigen.prepare(anigen.from_arrays(*tube())))
    rigs = folder / "rigs"
    rigs.mkdir()
    anigen.save(rigged, rigs / "a.glb")
    (rigs / "broken.glb").write_bytes(b"glTF")
    heard = []
    made = anigen.prepare(rigs, folder / "data", creatures=2, resolution=16, progress=lambda *what: heard.append(what[0]))
    assert made["assets"] == 3 and made["reused"] == 0 and heard, made
    assert [one["step"] for one in made["rejected"]] == ["import"] and "broken.glb" in made["rejected"][0]["source"]
    with np.load(next((folder / "data/skeleton").glob("*/skeleton_voxelized.npz"))) as arrays:
        assert {"joints", "parents", "skin", "vertices", "faces"} <= set(arrays)
    assert anigen.prepare([rigs], folder / "data", creatures=2, resolution=16)["reused"] == 3
    raises(anigen.Interrupted, "", lambda: anigen.prepare([], folder / "other", creatures=5, progress=lambda *_: False))
    raises(ZeroDivisionError, "", lambda: anigen.prepare([], folder / "third", creatures=5, progress=lambda *_: 1 / 0))
    raises(TypeError, "", lambda: anigen.prepare([], folder / "other", creatures=5, progress=3))
    raises(anigen.InputError, "nothing to prepare", lambda: anigen.prepare([], folder / "none"))
    raises(anigen.InputError, "missing", lambda: anigen.prepare(folder / "missing", folder / "none"))


def check_torch(rigged):
    try:
        import torch
    except ImportError:
        raises(anigen.Error, "python3-torch", lambda: anigen.to_torch(rigged))
        return
    tensors = anigen.to_torch(rigged)
    assert tensors["skin"].shape == (len(rigged.vertices), len(rigged.joints))
    before = float(tensors["vertices"][0, 0])
    tensors["vertices"][0, 0] = 7
    assert rigged.vertices[0, 0] == 7 and tensors["joints"].dtype == torch.float64
    tensors["vertices"][0, 0] = before


def check_generator(weights):
    generator = anigen.Generator(runs=weights)
    image = source / "examples/creatures/deer.png"
    stages = set()
    seen = {}
    made = generator.generate(image, progress=lambda stage, _: stages.add(stage.split(" of ")[0]),
                              pictures=lambda name, png: seen.update({name: png}))
    assert {"sparse structure", "structured latents"} <= stages, stages
    asset = made.asset
    assert len(asset.joints) > 3 and made.notices and asset.clips and made.seconds["decode"] > 0
    assert {"mask", "voxels"} <= set(seen) and all(png[1:4] == b"PNG" for png in seen.values()), seen.keys()
    stopped = generator.generate(image.read_bytes(), stop_at="voxels")
    assert stopped.asset is None and stopped.voxels == made.voxels
    on = generator.generate(image, voxels=stopped.voxels).asset
    assert np.array_equal(on.vertices, asset.vertices) and np.array_equal(on.skin, asset.skin)
    generator.generate(image, mask=seen["mask"], stop_at="voxels")
    raises(anigen.InputError, "voxels", lambda: generator.generate(image, voxels=made.voxels[:200]))
    raises(ZeroDivisionError, "", lambda: generator.generate(image, pictures=lambda *_: 1 / 0))
    raises(ZeroDivisionError, "", lambda: generator.generate(image, stop_at="voxels", progress=lambda *_: 1 / 0))
    raises(TypeError, "incompatible function arguments", lambda: anigen.save_bytes(stopped.asset))
    raises(anigen.InputError, "", lambda: generator.generate(b"no image"))
    found, how = anigen.rig(asset, keep_skeleton=False)
    assert len(found.joints) > 1, how


with tempfile.TemporaryDirectory() as folder:
    check_openblas(packages)
    check_arrays()
    check_numbers()
    rigged = check_files(pathlib.Path(folder))
    check_none(pathlib.Path(folder), rigged)
    check_measures(rigged)
    check_jobs(rigged)
    check_preparation(pathlib.Path(folder), rigged)
    check_torch(rigged)
    if len(sys.argv) > 3 and pathlib.Path(sys.argv[3]).is_dir():
        check_generator(sys.argv[3])
print("the Python package works")
