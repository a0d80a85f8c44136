"""The Blender add-on rigs a mesh: run inside Blender.

    blender --background --factory-startup --python blender_addon.py -- ADDON PROGRAMS"""
import os
import shutil
import subprocess
import sys
import tempfile

import bpy

addon, programs = sys.argv[sys.argv.index("--") + 1:]
folder = bpy.utils.user_resource("SCRIPTS", path="addons", create=True)
shutil.copy(addon, folder)
if folder not in sys.path:  # made after Blender had started
    sys.path.append(folder)
name = os.path.basename(addon)[:-3]
bpy.ops.preferences.addon_enable(module=name)
assert name in bpy.context.preferences.addons, "the add-on cannot be enabled"

bpy.ops.object.select_all(action="SELECT")
bpy.ops.object.delete()
bpy.ops.mesh.primitive_cylinder_add(radius=0.2, depth=2, vertices=24)
tube = bpy.context.object
bpy.ops.object.mode_set(mode="EDIT")
bpy.ops.mesh.subdivide(number_cuts=6)
bpy.ops.object.mode_set(mode="OBJECT")
places = sorted(round((tube.matrix_world @ v.co).z, 4) for v in tube.data.vertices)

try:
    bpy.ops.anigen.rig(program="/no/such/program")
    raise AssertionError("a program that is not there was not refused")
except RuntimeError as error:
    assert "anigen-rig" in str(error), error


def check_bound(tube):
    armatures = [thing for thing in bpy.data.objects if thing.type == "ARMATURE"]
    assert len(armatures) == 1 and len(armatures[0].data.bones) == 5, [len(a.data.bones) for a in armatures]
    meshes = [thing for thing in bpy.data.objects
              if thing.type == "MESH" and any(modifier.type == "ARMATURE" for modifier in thing.modifiers)]
    assert len(meshes) == 1 and len(meshes[0].vertex_groups) == 5
    bound = sorted(round((meshes[0].matrix_world @ v.co).z, 4) for v in meshes[0].data.vertices)
    assert abs(bound[0] - places[0]) < 1e-3 and abs(bound[-1] - places[-1]) < 1e-3, (bound[0], places[0])
    assert all(abs(sum(g.weight for g in v.groups) - 1) < 1e-3 for v in meshes[0].data.vertices)
    assert tube.hide_get()
    for thing in armatures + meshes:
        bpy.data.objects.remove(thing)
    tube.hide_set(False)
    tube.select_set(True)
    bpy.context.view_layer.objects.active = tube


tube.select_set(True)
bpy.context.view_layer.objects.active = tube
assert bpy.ops.anigen.rig(program=programs, method="curve", joints=5) == {"FINISHED"}
check_bound(tube)

# By a studio: named in the call, then in the preferences.
if os.path.exists(os.path.join(programs, "anigen-studio")):
    jobs = tempfile.mkdtemp()
    studio = subprocess.Popen([os.path.join(programs, "anigen-studio"), "--output", jobs, "--quiet"],
                              stdout=subprocess.PIPE, text=True)
    try:
        address = studio.stdout.readline().strip()
        assert bpy.ops.anigen.rig(address=address, method="curve", joints=5) == {"FINISHED"}
        check_bound(tube)
        bpy.context.preferences.addons[name].preferences.address = address
        assert bpy.ops.anigen.rig(method="curve", joints=5) == {"FINISHED"}
        check_bound(tube)
        assert bpy.ops.anigen.rig(method="curve", joints=5, names="chain") == {"FINISHED"}
        for options, words in (({"method": "anigen"}, "Automatic asks"),
                               ({"method": "curve", "names": "unity"}, "humanoids")):
            try:
                bpy.ops.anigen.rig(**options)
                raise AssertionError(f"{options} were not refused")
            except RuntimeError as error:
                assert words in str(error), error
    finally:
        studio.terminate()
        studio.wait(60)
        shutil.rmtree(jobs)
    try:
        bpy.ops.anigen.rig(method="curve")
        raise AssertionError("a studio that is not there was not refused")
    except RuntimeError as error:
        assert "no studio answers" in str(error), error
print("the Blender add-on works")
