"""Rigs the selected meshes of Blender with the program anigen-rig, or by a running anigen-studio.

Install: Edit > Preferences > Add-ons > Install..., this file. The panel is in the sidebar of the 3D view (N), tab AniGen.
Without a window: blender --background file.blend --python this_file.py, then bpy.ops.anigen.rig()."""
import http.client
import json
import os
import secrets
import shutil
import subprocess
import tempfile
import time
import urllib.parse

import bpy
import numpy

bl_info = {
    "name": "AniGen rig",
    "author": "The AniGen in C++ authors",
    "version": (0, 2, 0),
    "blender": (3, 4, 0),
    "location": "3D view > Sidebar > AniGen",
    "description": "Joints and skin weights for the selected meshes by anigen-rig or anigen-studio",
    "category": "Rigging",
}

METHODS = [("auto", "Automatic", "Learned joints where they are sure, else a template that fits, else the curve of the mesh"),
           ("curve", "Curve", "Joints along the curve that the mesh contracts to"),
           ("pinocchio", "Template", "A template embedded in the mesh"),
           ("anigen", "Learned", "Joints by the flows of the shipped models")]
NAMES = [("none", "As they are", ""), ("chain", "Blender", "Names that Blender can mirror"),
         ("unity", "Unity", ""), ("unreal", "Unreal", ""), ("vrm", "VRM", "")]


def find_program(asked):
    """The program's path, or None. @param asked a file, or a folder that holds it; empty: on the PATH"""
    if not asked:
        return shutil.which("anigen-rig")
    asked = bpy.path.abspath(asked)
    file = os.path.join(asked, "anigen-rig") if os.path.isdir(asked) else asked
    return file if os.access(file, os.X_OK) else None


class Failed(Exception):
    """A sentence for the user."""


def ask_studio(address, method, path, body=None, headers=None):
    """Asks a studio over HTTP. @param address that it prints, with its token where it has one @return the body"""
    parts = urllib.parse.urlsplit(address if "://" in address else "http://" + address)
    token = urllib.parse.parse_qs(parts.query).get("token", [""])[0]
    headers = dict(headers or {}, **({"Authorization": "Bearer " + token} if token else {}))
    secure = parts.scheme == "https"
    try:
        connection = (http.client.HTTPSConnection if secure else http.client.HTTPConnection)(parts.netloc, timeout=60)
        try:
            connection.request(method, parts.path.rstrip("/") + path, body, headers)
            answer = connection.getresponse()
            content = answer.read()
        finally:
            connection.close()
    except (OSError, ValueError, http.client.HTTPException) as error:
        raise Failed(f"no studio answers at {address}: {error}") from error
    if answer.status >= 400:
        try:
            raise Failed(json.loads(content)["error"])
        except (ValueError, KeyError, TypeError) as error:
            raise Failed(f"the studio at {address} answers with status {answer.status}") from error
    return content


def studio_json(*request, **more):
    try:
        return json.loads(ask_studio(*request, **more))
    except ValueError as error:
        raise Failed(f"{request[0]} is no anigen-studio") from error


def rig_by_studio(address, mesh, rigged, options):
    """Rigs a file into a file. @return how it was done, in a sentence"""
    boundary = secrets.token_hex(16)
    with open(mesh, "rb") as file:
        content = file.read()
    part = f'--{boundary}\r\nContent-Disposition: form-data; name="%s"%s\r\n\r\n'
    body = ((part % ("options", "")) + json.dumps(options) + "\r\n" +
            part % ("file", '; filename="mesh.glb"')).encode() + content + f"\r\n--{boundary}--\r\n".encode()
    job = studio_json(address, "POST", "/v1/3d/rigs", body=body,
                      headers={"Content-Type": f"multipart/form-data; boundary={boundary}"})
    while job["state"] in ("queued", "running"):
        time.sleep(0.2)
        job = studio_json(address, "GET", "/v1/jobs/" + job["id"])
    if job["state"] != "done":
        raise Failed(job.get("error") or f"the job was {job['state']}")
    with open(rigged, "wb") as file:
        file.write(ask_studio(address, "GET", f"/v1/jobs/{job['id']}/files/rigged.glb"))
    return job.get("note", "")


def rig_by_program(program, mesh, rigged, words):
    """Rigs a file into a file. @return how it was done, in a sentence"""
    done = subprocess.run([program, "--mesh", mesh, "--output", rigged] + words, capture_output=True, text=True)
    if done.returncode != 0 or not os.path.isfile(rigged):
        lines = [line for line in done.stderr.splitlines() if line.strip()]
        raise Failed(lines[-1] if lines else "anigen-rig failed")
    said = done.stdout.strip().splitlines()
    return said[-1].split(", ", 1)[-1] if said else ""


class Preferences(bpy.types.AddonPreferences):
    bl_idname = __name__
    program: bpy.props.StringProperty(name="anigen-rig", subtype="FILE_PATH",
                                      description="The program or its folder; empty: found on the PATH")
    address: bpy.props.StringProperty(name="Address of a studio",
                                      description="As anigen-studio prints it: used in place of the program; empty: none")

    def draw(self, context):
        self.layout.prop(self, "program")
        self.layout.prop(self, "address")


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
    address: bpy.props.StringProperty(name="Address of a studio", default="", options={"SKIP_SAVE"})

    @classmethod
    def poll(cls, context):
        return any(thing.type == "MESH" for thing in context.selected_objects)

    def program_words(self):
        """Options of anigen-rig."""
        words = ["--method", self.method, "--bone-axes", "along"]
        if self.method == "auto":
            words.append("--new-skeleton")
        if self.joints > 0:
            words += ["--joints", str(self.joints)]
        if self.symmetric:
            words.append("--symmetric")
        if self.names != "none":
            words += ["--names", self.names]
        return words

    def studio_options(self):
        """Options of a studio's rigs."""
        if self.method == "anigen":
            raise Failed("a studio has no learned joints of their own: Automatic asks for them")
        options = {"method": self.method, "motions": [], "joints": self.joints, "symmetric": self.symmetric,
                   "bone_axes": "along"}
        if self.method == "auto":
            options["keep_skeleton"] = False
        if self.names != "none":
            options["names"] = self.names
        return options

    def rig(self, context, mesh, rigged):
        """@return how it was done, in a sentence @raises Failed"""
        addon = context.preferences.addons.get(__name__)
        address = self.address or (addon.preferences.address if addon and not self.program else "")
        if address:
            return rig_by_studio(address, mesh, rigged, self.studio_options())
        program = find_program(self.program or (addon.preferences.program if addon else ""))
        if program is None:
            raise Failed("anigen-rig is not on the PATH; name it, or a studio, in the add-on's preferences")
        return rig_by_program(program, mesh, rigged, self.program_words())

    def execute(self, context):
        originals = [thing for thing in context.selected_objects if thing.type == "MESH"]
        for thing in context.selected_objects:
            thing.select_set(thing in originals)
        with tempfile.TemporaryDirectory(prefix="anigen-") as folder:
            mesh, rigged = os.path.join(folder, "mesh.glb"), os.path.join(folder, "rigged.glb")
            bpy.ops.export_scene.gltf(filepath=mesh, use_selection=True, export_skins=False, export_animations=False,
                                      export_apply=True)
            try:
                how = self.rig(context, mesh, rigged)
            except Failed as error:
                self.report({"ERROR"}, str(error))
                return {"CANCELLED"}
            if "bool" not in vars(numpy):
                numpy.bool = bool  # the importer of Blender 3.4 uses a name that numpy 1.24 dropped
            bpy.ops.import_scene.gltf(filepath=rigged, bone_heuristic="BLENDER")
            if how:
                self.report({"INFO"}, how)
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
