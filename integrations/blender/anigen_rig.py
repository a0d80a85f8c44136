"""Rigs the selected meshes of Blender with the program anigen-rig.

Install: Edit > Preferences > Add-ons > Install..., this file. The panel is in the sidebar of the 3D view (N), tab AniGen.
Without a window: blender --background file.blend --python this_file.py, then bpy.ops.anigen.rig()."""
import os
import shutil
import subprocess
import tempfile

import bpy
import numpy

bl_info = {
    "name": "AniGen rig",
    "author": "The AniGen in C++ authors",
    "version": (0, 2, 0),
    "blender": (3, 4, 0),
    "location": "3D view > Sidebar > AniGen",
    "description": "Joints and skin weights for the selected meshes by anigen-rig",
    "category": "Rigging",
}

METHODS = [("auto", "Automatic", "A template that fits, else learned joints, else the curve of the mesh"),
           ("curve", "Curve", "Joints along the curve that the mesh contracts to"),
           ("pinocchio", "Template", "A template embedded in the mesh"),
           ("anigen", "Learned", "Joints by the flows of the shipped models")]
NAMES = [("none", "As they are", ""), ("blender", "Blender", "Names that Blender can mirror"),
         ("unity", "Unity", ""), ("unreal", "Unreal", ""), ("vrm", "VRM", "")]


def find_program(asked):
    """The program's path, or None. @param asked a file, or a folder that holds it; empty: on the PATH"""
    if not asked:
        return shutil.which("anigen-rig")
    asked = bpy.path.abspath(asked)
    file = os.path.join(asked, "anigen-rig") if os.path.isdir(asked) else asked
    return file if os.access(file, os.X_OK) else None


class Preferences(bpy.types.AddonPreferences):
    bl_idname = __name__
    program: bpy.props.StringProperty(name="anigen-rig", subtype="FILE_PATH",
                                      description="The program or its folder; empty: found on the PATH")

    def draw(self, context):
        self.layout.prop(self, "program")


class AnigenRig(bpy.types.Operator):
    """Gives the selected meshes an armature and skin weights"""
    bl_idname = "anigen.rig"
    bl_label = "Rig selected meshes"
    bl_options = {"REGISTER", "UNDO"}

    method: bpy.props.EnumProperty(name="Joints", items=METHODS, default="auto")
    joints: bpy.props.IntProperty(name="Number", description="0: as many as fit", default=0, min=0, max=1000)
    symmetric: bpy.props.BoolProperty(name="Symmetric", default=False)
    names: bpy.props.EnumProperty(name="Names", items=NAMES, default="none")
    hide_originals: bpy.props.BoolProperty(name="Hide the originals", default=True)
    program: bpy.props.StringProperty(name="Program", default="", options={"SKIP_SAVE"})

    @classmethod
    def poll(cls, context):
        return any(thing.type == "MESH" for thing in context.selected_objects)

    def execute(self, context):
        addon = context.preferences.addons.get(__name__)
        program = find_program(self.program or (addon.preferences.program if addon else ""))
        if program is None:
            self.report({"ERROR"}, "anigen-rig is not on the PATH; name it in the add-on's preferences")
            return {"CANCELLED"}
        originals = [thing for thing in context.selected_objects if thing.type == "MESH"]
        for thing in context.selected_objects:
            thing.select_set(thing in originals)
        with tempfile.TemporaryDirectory(prefix="anigen-") as folder:
            mesh, rigged = os.path.join(folder, "mesh.glb"), os.path.join(folder, "rigged.glb")
            bpy.ops.export_scene.gltf(filepath=mesh, use_selection=True, export_skins=False, export_animations=False,
                                      export_apply=True)
            words = [program, "--mesh", mesh, "--output", rigged, "--method", self.method, "--bone-axes", "along"]
            if self.method == "auto":
                words.append("--new-skeleton")
            if self.joints > 0:
                words += ["--joints", str(self.joints)]
            if self.symmetric:
                words.append("--symmetric")
            if self.names != "none":
                words += ["--names", self.names]
            done = subprocess.run(words, capture_output=True, text=True)
            if done.returncode != 0 or not os.path.isfile(rigged):
                lines = [line for line in done.stderr.splitlines() if line.strip()]
                self.report({"ERROR"}, lines[-1] if lines else "anigen-rig failed")
                return {"CANCELLED"}
            if "bool" not in vars(numpy):
                numpy.bool = bool  # the importer of Blender 3.4 uses a name that numpy 1.24 dropped
            bpy.ops.import_scene.gltf(filepath=rigged, bone_heuristic="BLENDER")
            said = done.stdout.strip().splitlines()
            if said:
                self.report({"INFO"}, said[-1].split(", ", 1)[-1])
        if self.hide_originals:
            for thing in originals:
                thing.hide_set(True)
        return {"FINISHED"}


class Panel(bpy.types.Panel):
    bl_idname = "VIEW3D_PT_anigen"
    bl_label = "AniGen"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "AniGen"

    def draw(self, context):
        self.layout.operator_context = "INVOKE_DEFAULT"
        self.layout.operator(AnigenRig.bl_idname, icon="ARMATURE_DATA")


CLASSES = (Preferences, AnigenRig, Panel)


def register():
    for one in CLASSES:
        bpy.utils.register_class(one)


def unregister():
    for one in reversed(CLASSES):
        bpy.utils.unregister_class(one)


if __name__ == "__main__":
    register()
