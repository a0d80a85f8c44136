"""Opens pairs of GLB files in Blender and compares where their vertices are while all armatures rest.

    blender --background --factory-startup --python-exit-code 1 --python scripts/compare_in_blender.py -- BEFORE AFTER ...

A line of JSON per pair: the largest distance of a vertex from the one of the same number in the mesh of the same name,
as a share of the diagonal of the first file's box. Exit code 1 where a file cannot be opened, meshes are missing, or
the distance is more than 1e-5.
"""
import json
import sys

import bpy
import numpy

MOST = 1e-5

# The importers of Debian 12's Blender (3.4) use names that its numpy (1.24) no longer has.
for name, meant in (("bool", bool), ("float", float), ("int", int), ("object", object)):
    if name not in numpy.__dict__:
        setattr(numpy, name, meant)


def positions(path):
    """Vertices of every mesh in world axes, by the mesh's name."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=path)
    for armature in bpy.data.armatures:
        armature.pose_position = "REST"
    bpy.context.view_layer.update()
    graph = bpy.context.evaluated_depsgraph_get()
    shapes = {bone.custom_shape for o in bpy.data.objects if o.type == "ARMATURE" for bone in o.pose.bones}
    result = {}
    for mesh in bpy.data.objects:
        if mesh.type != "MESH" or mesh in shapes:
            continue
        evaluated = mesh.evaluated_get(graph)
        data = evaluated.to_mesh()
        local = numpy.empty(3 * len(data.vertices))
        data.vertices.foreach_get("co", local)
        matrix = numpy.array(evaluated.matrix_world)
        result[mesh.name] = local.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
        evaluated.to_mesh_clear()
    return result


def compare(before, after):
    first, second = positions(before), positions(after)
    if not first:
        raise ValueError("no mesh in the first file")
    if {k: v.shape for k, v in first.items()} != {k: v.shape for k, v in second.items()}:
        raise ValueError(f"other meshes: {sorted(first)} and {sorted(second)}")
    everything = numpy.concatenate(list(first.values()))
    size = numpy.linalg.norm(everything.max(axis=0) - everything.min(axis=0))
    return max(float(numpy.linalg.norm(first[k] - second[k], axis=1).max()) for k in first) / max(size, 1e-12)


def main():
    files = sys.argv[sys.argv.index("--") + 1:]
    failed = 0
    for before, after in zip(files[::2], files[1::2]):
        line = {"before": before, "after": after}
        try:
            line["distance"] = compare(before, after)
            failed += not line["distance"] <= MOST
        except Exception as error:  # an importer may raise anything
            line["error"] = str(error)[:300]
            failed += 1
        print("pair " + json.dumps(line), flush=True)
    sys.exit(1 if failed else 0)


main()
