"""Opens rigged GLB and FBX files in Blender, turns a bone of each, and looks whether the right vertices move.

    blender --background --factory-startup --python scripts/check_in_blender.py -- FILE...

For every file: one armature, at least one mesh bound to it, weights of every vertex summing to 1. The bone that holds
most of the mesh, but not nearly all of it, is turned by 40 degrees. All below a bone moves rigidly with it, so a vertex
must be found at (1 - w) p + w T p, where w is the sum of its weights on the bone and its descendants and T the bone's
motion: to 1e-5 of the object's size for those that stay, to 1e-4 for those that move, and some must move. That holds
for files that rest in their bind pose, as those that anigen-generate writes.
Exit code 1 when a file fails.
"""
import math
import sys

import bpy
import numpy
from mathutils import Quaternion

STILL = 1e-5
EXACT = 1e-4

# The importers of Debian 12's Blender (3.4) use names that its numpy (1.24) no longer has.
for name, meant in (("bool", bool), ("float", float), ("int", int), ("object", object)):
    if name not in numpy.__dict__:
        setattr(numpy, name, meant)


def moved_positions(mesh):
    evaluated = mesh.evaluated_get(bpy.context.evaluated_depsgraph_get())
    data = evaluated.to_mesh()
    positions = [evaluated.matrix_world @ vertex.co for vertex in data.vertices]
    evaluated.to_mesh_clear()
    return positions


def weights_of(mesh):
    names = {group.index: group.name for group in mesh.vertex_groups}
    return [{names[g.group]: g.weight for g in vertex.groups if g.weight > 0} for vertex in mesh.data.vertices]


def require(condition, message):
    if not condition:
        raise AssertionError(message)


def check(path):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if path.lower().endswith(".fbx"):
        bpy.ops.import_scene.fbx(filepath=path)
    else:
        bpy.ops.import_scene.gltf(filepath=path)
    armatures = [o for o in bpy.data.objects if o.type == "ARMATURE"]
    require(len(armatures) == 1, f"{len(armatures)} armatures")
    armature = armatures[0]
    meshes = [o for o in bpy.data.objects
              if o.type == "MESH" and any(m.type == "ARMATURE" and m.object == armature for m in o.modifiers)]
    require(meshes, "no mesh is bound to the armature")
    armature.animation_data_clear()

    held = {bone.name: {bone.name} | {b.name for b in bone.children_recursive} for bone in armature.data.bones}
    weights = {mesh: weights_of(mesh) for mesh in meshes}
    rows = [row for mesh in meshes for row in weights[mesh]]
    worst = max((sum(row.values()) for row in rows), key=lambda total: abs(total - 1))
    require(abs(worst - 1) < 1e-3, f"weights of a vertex sum to {worst}")
    def share(bone):
        return sum(row.get(name, 0) for row in rows for name in held[bone]) / len(rows)
    bones = sorted((b for b in held if share(b) > 0), key=share)
    require(bones, "no bone moves anything")
    bone = next((b for b in reversed(bones) if share(b) < 0.9), bones[0])

    before = {mesh: moved_positions(mesh) for mesh in meshes}
    size = max(max(p[k] for mesh in meshes for p in before[mesh]) - min(p[k] for mesh in meshes for p in before[mesh])
               for k in range(3))
    pose = armature.pose.bones[bone]
    start = armature.matrix_world @ pose.matrix
    pose.rotation_mode = "QUATERNION"
    pose.rotation_quaternion = pose.rotation_quaternion @ Quaternion((1, 0, 0), math.radians(40))
    bpy.context.view_layer.update()
    motion = armature.matrix_world @ pose.matrix @ start.inverted()

    moved = 0
    farthest = stray = wrong = 0.0
    for mesh in meshes:
        for row, old, new in zip(weights[mesh], before[mesh], moved_positions(mesh)):
            weight = sum(row.get(name, 0) for name in held[bone]) / sum(row.values())  # as Blender divides
            distance = (new - old).length / size
            if weight == 0:
                stray = max(stray, distance)
            wrong = max(wrong, (new - old.lerp(motion @ old, weight)).length / size)
            farthest = max(farthest, distance)
            moved += distance > 1e-3
    require(stray < STILL, f"a vertex without weight on {bone} moved by {stray:.2g} of the size")
    require(wrong < EXACT, f"{bone} was turned, and a vertex is {wrong:.2g} of the size from where its weights put it")
    require(farthest > 0.005, f"{bone} was turned and nothing moves")
    print(f"{path}: {len(armature.data.bones)} bones, {len(rows)} vertices; {bone} turned: {moved} vertices move, by up to "
          f"{farthest:.3f} of the size, each where its weights put it ({wrong:.1e}); the rest stays ({stray:.1e})")


def main():
    files = sys.argv[sys.argv.index("--") + 1:] if "--" in sys.argv else []
    failed = 0
    for path in files:
        try:
            check(path)
        except Exception as error:
            failed += 1
            print(f"{path}: FAILED: {error}")
    print(f"{len(files)} files, {failed} failed")
    sys.stdout.flush()
    sys.exit(1 if failed or not files else 0)


main()
