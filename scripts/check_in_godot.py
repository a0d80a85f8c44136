#!/usr/bin/env python3
"""Imports GLB files into Godot 3 without a display, and compares what it makes of them with what the files say.

    scripts/check_in_godot.py [--godot PROGRAM] [--seconds N] FILE.glb...

Compared: joints of the skins with bones of the Skeletons, by number and name (3.2 writes LeftFoot as left_foot,
bone_001 as bone_1); animations by number, name and length; primitives with surfaces, and their numbers of vertices;
vertices of skinned meshes with those that have joints and weights in Godot.
check_in_godot.gd must lie beside this file. PROGRAM is Godot 3 with its editor [godot3-server]. Needs nothing but Python.
Exit status 1 when a file does not load or something differs.
"""
import argparse
import glob
import json
import os
import re
import shutil
import struct
import subprocess
import sys
import tempfile
import time


def bare(name):
    """A name as Godot 3.2 still tells it: in small letters, words and numbers apart, numbers without zeros before them."""
    words = [word.lstrip("0") or "0" if word.isdigit() else word for word in re.findall("[a-z]+|[0-9]+", name.lower())]
    return re.sub("(?<=[a-z]) (?=[a-z])", "", " ".join(words))


def of_file(path):
    data = open(path, "rb").read()
    gltf = json.loads(data[20:20 + struct.unpack_from("<I", data, 12)[0]])
    nodes, accessors = gltf.get("nodes", []), gltf.get("accessors", [])
    surfaces, bound = [], 0
    for node in nodes:
        if "mesh" not in node:
            continue
        for part in gltf["meshes"][node["mesh"]]["primitives"]:
            surfaces.append(accessors[part["attributes"]["POSITION"]]["count"])
            bound += surfaces[-1] if "skin" in node else 0
    clips = sorted((bare(clip["name"]), max(accessors[s["input"]]["max"][0] for s in clip["samplers"]))
                   for clip in gltf.get("animations", []))
    joints = {j for skin in gltf.get("skins", []) for j in skin["joints"]}
    return {"joints": [nodes[j].get("name", "") for j in sorted(joints)], "surfaces": sorted(surfaces), "bound": bound,
            "clips": clips}


def main():
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("--godot", default="godot3-server")
    parser.add_argument("--seconds", type=int, default=100, help="longest time to import in")
    parser.add_argument("files", nargs="+")
    options = parser.parse_args()
    here = os.path.dirname(os.path.abspath(__file__))
    with tempfile.TemporaryDirectory() as project:
        open(os.path.join(project, "project.godot"), "w").write("config_version=4\n")
        shutil.copy(os.path.join(here, "check_in_godot.gd"), project)
        said = {}
        for number, path in enumerate(options.files):
            name = "%03d.glb" % number
            shutil.copy(path, os.path.join(project, name))
            said[name] = (path, of_file(path))
        home = dict(os.environ, HOME=project, XDG_CACHE_HOME=project, XDG_CONFIG_HOME=project, XDG_DATA_HOME=project)
        # The editor of 3.2, told to quit, quits either before it has imported anything or never.
        with open(os.path.join(project, "log.txt"), "w+") as log:
            godot = [options.godot, "--path", project]
            editor = subprocess.Popen(godot + ["--editor"], stdout=log,
                                      stderr=subprocess.STDOUT, env=home)
            end, done = time.time() + options.seconds, 0
            while time.time() < end and editor.poll() is None and done < len(said):
                time.sleep(1)
                done = len(glob.glob(os.path.join(project, ".import", "*.md5")))
            time.sleep(2)
            editor.kill()
            editor.wait()
            subprocess.run(godot + ["--script", "check_in_godot.gd"], stdout=log, stderr=subprocess.STDOUT, env=home,
                           timeout=options.seconds)
            log.seek(0)
            log = log.read()
        found = {}
        for line in log.splitlines():
            if line.startswith("GODOT "):
                one = json.loads(line[6:])
                found[one["file"]] = one
        errors = sorted({line for line in log.splitlines() if "ERROR" in line and "GODOT " not in line and "ocale" not in line})
    print("| file | bones / joints | names | surfaces / primitives | vertices | bound | clips | longest error of a length, s "
          "| |\n" + "|---" * 9 + "|")
    failed = 0
    for name, (path, file) in said.items():
        one = found.get(name)
        if one is None or not one["loaded"]:
            failed += 1
            print("| %s | does not load |" % os.path.basename(path))
            continue
        faults = []
        bones = [b for skeleton in one["skeletons"] for b in skeleton]
        exact = len(set(file["joints"]) & set(bones))
        known = {bare(bone) for bone in bones}
        missing = sorted(name for name in file["joints"] if bare(name) not in known)
        surfaces = sorted(int(s) for mesh in one["meshes"] for s in mesh["surfaces"])
        bound = int(sum(mesh["bound"] for mesh in one["meshes"]))
        clips = sorted((bare(clip["name"]), clip["length"]) for clip in one["clips"])
        if len(bones) != len(file["joints"]):
            faults.append("bones beyond joints: %s" % sorted(set(bones) - set(file["joints"]))[:5])
        if missing:
            faults.append("names missing: %s" % missing[:5])
        if len(surfaces) != len(file["surfaces"]):
            faults.append("surfaces")
        if sum(surfaces) != sum(file["surfaces"]):
            faults.append("vertices")
        if bound != file["bound"]:
            faults.append("bound vertices")
        if [name for name, _ in clips] != [name for name, _ in file["clips"]]:
            faults.append("names of clips %s" % sorted({c[0] for c in clips} ^ {c[0] for c in file["clips"]})[:6])
        off = max([abs(there - here) for (_, there), (_, here) in zip(clips, file["clips"])], default=0.0)
        if off > 1e-3:
            faults.append("lengths")
        failed += bool(faults)
        print("| %s | %d / %d | %d same, %d missing | %d / %d | %d / %d | %d / %d | %d / %d | %.1e | %s |" %
              (os.path.basename(path), len(bones), len(file["joints"]), exact, len(missing), len(surfaces),
               len(file["surfaces"]), sum(surfaces), sum(file["surfaces"]), bound, file["bound"], len(clips), len(file["clips"]), off,
               "; ".join(faults) or "ok"))
    for line in errors[:20]:
        print(line)
    print("%d files, %d failed" % (len(said), failed))
    sys.exit(1 if failed else 0)


main()
