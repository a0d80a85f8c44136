"""Binds rigged GLB files anew by Blender's automatic weights (bone heat), to compare ours with.

    blender --background --factory-startup --python scripts/blender_heat.py -- OUT_FOLDER FILE.glb...

Give it files that rest in their bind pose, such as those of `anigen-rig --method heat`. glTF has joints without ends, so
that every bone first gets one: its child's joint where there is one child, the middle of them where there are several,
and at the tips half of the parent's bone straight on. Vertices at one place count as one while Blender solves. Vertices
that it leaves without weights are counted; they keep their place on the nearest vertex that has some.
Exit code 1 when a file fails.
"""
import os
import sys

import bpy
import numpy
from mathutils import Vector
from mathutils.kdtree import KDTree

if not hasattr(numpy, "bool"):
    numpy.bool = bool


def set_ends(armature):
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    bones = armature.data.edit_bones
    for bone in bones:
        bone.use_connect = False
    ends = {}
    for bone in bones:
        if bone.children:
            ends[bone.name] = sum((c.head for c in bone.children), Vector()) / len(bone.children)
        elif bone.parent:
            ends[bone.name] = bone.head + 0.5 * (bone.head - bone.parent.head)
        else:
            ends[bone.name] = bone.tail.copy()
    for bone in bones:
        if (ends[bone.name] - bone.head).length > 1e-5:
            bone.tail = ends[bone.name]
    bpy.ops.object.mode_set(mode="OBJECT")


def one_surface(mesh):
    """A copy of the mesh in which vertices at one place are one, which is what Blender's solver needs."""
    copy = mesh.copy()
    copy.data = mesh.data.copy()
    bpy.context.collection.objects.link(copy)
    copy.vertex_groups.clear()
    copy.modifiers.clear()
    copy.parent = None
    copy.matrix_world = mesh.matrix_world
    bpy.ops.object.select_all(action="DESELECT")
    copy.select_set(True)
    bpy.context.view_layer.objects.active = copy
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.remove_doubles(threshold=1e-6)
    bpy.ops.object.mode_set(mode="OBJECT")
    return copy


def bind(armature, mesh):
    welded = one_surface(mesh)
    bpy.ops.object.select_all(action="DESELECT")
    welded.select_set(True)
    armature.select_set(True)
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.parent_set(type="ARMATURE_AUTO")
    names = {g.index: g.name for g in welded.vertex_groups}
    rows = [{names[g.group]: g.weight for g in v.groups if g.weight > 0} for v in welded.data.vertices]
    weighted = [i for i, row in enumerate(rows) if row]
    if not weighted:
        raise AssertionError("Blender gives no vertex any weight")
    tree = KDTree(len(weighted))
    for i in weighted:
        tree.insert(welded.data.vertices[i].co, i)
    tree.balance()
    mesh.vertex_groups.clear()
    groups = {}
    for vertex in mesh.data.vertices:
        row = rows[tree.find(vertex.co)[1]]
        for name, weight in row.items():
            if name not in groups:
                groups[name] = mesh.vertex_groups.new(name=name)
            groups[name].add([vertex.index], weight / sum(row.values()), "REPLACE")
    bpy.data.objects.remove(welded, do_unlink=True)
    return len(rows) - len(weighted), len(rows)


def main(out, files):
    failed = 0
    for path in files:
        try:
            bpy.ops.wm.read_factory_settings(use_empty=True)
            bpy.ops.import_scene.gltf(filepath=path)
            armature = next(o for o in bpy.data.objects if o.type == "ARMATURE")
            armature.animation_data_clear()
            set_ends(armature)
            bare = total = 0
            for mesh in [o for o in bpy.data.objects if o.type == "MESH" and o.find_armature() == armature]:
                b, t = bind(armature, mesh)
                bare, total = bare + b, total + t
            target = os.path.join(out, os.path.basename(path))
            bpy.ops.export_scene.gltf(filepath=target, export_format="GLB", export_animations=False,
                                      export_all_influences=False)
            print(f"{path}: bound by Blender, {bare} of {total} vertices without weights")
        except Exception as error:  # Blender's own errors are RuntimeErrors without a common base
            failed += 1
            print(f"{path}: FAILED: {error}")
    return failed


arguments = sys.argv[sys.argv.index("--") + 1:]
os.makedirs(arguments[0], exist_ok=True)
sys.exit(1 if main(arguments[0], arguments[1:]) else 0)
