#!/usr/bin/env python3
"""Predictions for a dataset's assets as three programs might give them, to measure what evaluating many costs.

    make_predictions.py DATASET COUNT OUTPUT

Writes OUTPUT/split.txt with the ids of COUNT assets and three folders of files called by them:
ours: the GLB of another asset, as if something else had been generated; theirs: the asset's own GLB;
puppeteer: a text rig without mesh (Z up) of the asset's skeleton, every joint moved by up to 0.02, and its weights."""
import array
import ast
import csv
import os
import pathlib
import random
import sys
import zipfile

CODES = {"<f4": "f", "<f8": "d", "<i4": "i", "<i8": "q"}


def arrays_of(path):
    """Name -> (shape, numbers) of an NPZ file's plain arrays."""
    found = {}
    with zipfile.ZipFile(path) as archive:
        for name in archive.namelist():
            data = archive.read(name)
            length = int.from_bytes(data[8:10], "little")
            header = ast.literal_eval(data[10:10 + length].decode())
            if header["descr"] not in CODES:
                continue
            numbers = array.array(CODES[header["descr"]])
            numbers.frombytes(data[10 + length:])
            found[name[:-4]] = (header["shape"], numbers)
    return found


def text_rig(npz, noise):
    parts = arrays_of(npz)
    (count, _), joints = parts["joints"]
    parents = parts["parents"][1]
    (vertices, _), skin = parts["skin"]
    lines = []
    for j in range(count):
        lines.append("joints joint%d %.8f %.8f %.8f" % (j, *(joints[3 * j + k] + noise.uniform(-0.02, 0.02) for k in range(3))))
    lines.append("root joint%d" % next(j for j in range(count) if parents[j] < 0))
    for v in range(vertices):
        row = skin[v * count:(v + 1) * count]
        lines.append("skin %d " % v + " ".join("joint%d %.4f" % (j, w) for j, w in enumerate(row) if w > 0))
    lines += ["hier joint%d joint%d" % (parents[j], j) for j in range(count) if parents[j] >= 0]
    return "\n".join(lines) + "\n"


def main():
    dataset, count, output = pathlib.Path(sys.argv[1]), int(sys.argv[2]), pathlib.Path(sys.argv[3])
    with open(dataset / "metadata.csv", newline="") as table:
        ids = [row["sha256"] for row in csv.DictReader(table)
               if row["is_bad_skeleton"] != "True" and row["is_bad_skin"] != "True" and not row["variant_of"]]
    ids = [name for name in ids if (dataset / "assets" / (name + ".glb")).exists()][:count]
    if len(ids) < count:
        sys.exit("only %d assets" % len(ids))
    for folder in ("ours", "theirs", "puppeteer"):
        os.makedirs(output / folder)
    (output / "split.txt").write_text("\n".join(ids) + "\n")
    noise = random.Random(0)
    for i, name in enumerate(ids):
        other = ids[(i + 7) % len(ids)]
        os.symlink((dataset / "assets" / (other + ".glb")).resolve(), output / "ours" / (name + ".glb"))
        os.symlink((dataset / "assets" / (name + ".glb")).resolve(), output / "theirs" / (name + ".glb"))
        rig = text_rig(dataset / "skeleton" / name / "skeleton_voxelized.npz", noise)
        (output / "puppeteer" / (name + ".txt")).write_text(rig)


main()
