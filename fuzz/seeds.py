#!/usr/bin/env python3
"""First inputs of the fuzz targets: small valid files that use what a reader knows.

    seeds.py FOLDER        writes FOLDER/TARGET/seed_NAME

Needs numpy; meshes compressed by Draco only where draco_encoder is installed."""
import base64
import collections
import io
import json
import pathlib
import pickle
import shutil
import struct
import subprocess
import sys
import tempfile
import types
import zipfile
import zlib

import numpy as np

OBJ = """mtllib a.mtl b.mtl
v 0 0 0 1 0 0
v 1 0 0 0 1 0
v 0 1 0
v 1 1 0 0.5 0.5 0.5 \\
1
vt 0 0
vt 1 0.5 0
vn 0 0 1
vn 0 0 2
o name
g group
s off
usemtl red
f 1 2 3
f 1/1 2/2 4/1 3/2
usemtl blue
f 1//1 2//2 3//1
f -1/-1/-1 -2/-2/-2 -3/-1/-2
fo 1/1/1 2/2/2 4/1/1
l 1 2
"""
MTL = """# colours
newmtl a
Ka 0 0 0
Kd 0.5 0.25 1
d 0.5
map_Kd -blendu on -o 0 0 0 -s 1 1 -mm 0 1 -bm 2 -clamp off -texres 8 -imfchan l input.png
newmtl b
Kd 0.5
Tr 0.25
d -halo 0.5
map_Kd missing.png
newmtl c
Kd spectral file.rfl 1
newmtl d
Kd xyz 0.1 0.2 0.3
newmtl a
map_Kd two words.png
"""
TEXT_RIG = "joints a 0 0 0\njoints b 1 0 0\njoints c 1 1 0\nroot a\nhier a b\nhier b c\nskin 0 a 1\nskin 1 a 0.5 b 0.5\nskin 2 c 1\nskin 3 b 0.25 c 0.75\n"
CONFIG = {"extends": ["input.base"], "a": {"name": "y", "b": 3}, "n": 2, "x": 1.5, "t": "one", "f": True, "l": [1, 2], "r": [0.5], "w": ["a", "b"],
          "o": {"p": {}}, "set": ["a.b=2", "l.0=[1]", "new.key.below=text", "o.p.q={\"a\":null}", "l.9=1", "=", "n.m=1", "extends", "l.x=1"]}
# 3 × 2 and 5 × 3 pixels.
PICTURES = {
    "gray.jpg":
        "/9j/4AAQSkZJRgABAQAAAQABAAD/2wBDAFA3PEY8MlBGQUZaVVBfeMiCeG5uePWvuZHI////////////////////////////////////////////////////wAALCAADAAUBAREA/8QA"
        "HwAAAQUBAQEBAQEAAAAAAAAAAAECAwQFBgcICQoL/8QAtRAAAgEDAwIEAwUFBAQAAAF9AQIDAAQRBRIhMUEGE1FhByJxFDKBkaEII0KxwRVS0fAkM2JyggkKFhcYGRolJicoKSo0NTY3"
        "ODk6Q0RFRkdISUpTVFVWV1hZWmNkZWZnaGlqc3R1dnd4eXqDhIWGh4iJipKTlJWWl5iZmqKjpKWmp6ipqrKztLW2t7i5usLDxMXGx8jJytLT1NXW19jZ2uHi4+Tl5ufo6erx8vP09fb3"
        "+Pn6/9oACAEBAAA/ABEXHQV//9k=",
    "lossy.webp": "UklGRjoAAABXRUJQVlA4IC4AAADwAQCdASoFAAMAB0CWJbACdH8AGBTe3IAA/ZwTg4c/PoUPvXtDWh+mFbRQAAAA",
    "lossless.webp": "UklGRjwAAABXRUJQVlA4TC8AAAAvBIAAAHdAkG0zxCLcH+QMIzN489+DDLC8AAYBIBGoWFJIIbgUVhg1ov/hIce+AAA=",
    "alpha.webp":
        "UklGRmIAAABXRUJQVlA4WAoAAAAQAAAABAAAAgAAQUxQSA0AAAABDzD/ERHiHh8R/Q8DAFZQOCAuAAAA8AEAnQEqBQADAAdAliWwAnR/ABWzKO8AAP2boN693CJyh2wPx3yT2Gou+iqA"
        "AA==",
}


class Seeds:
    def __init__(self, folder):
        self.folder = folder

    def add(self, target, name, data):
        path = self.folder / target / f"seed_{name}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data.encode() if isinstance(data, str) else data)


def npy(array, **options):
    out = io.BytesIO()
    np.lib.format.write_array(out, np.asanyarray(array, **options))
    return out.getvalue()


def arrays(seeds):
    """NPY files; the targets put them into archives."""
    numbers = np.arange(6).reshape(2, 3)
    for dtype in ("?", "u1", "i1", "<i2", ">i2", "<u2", "<i4", ">u4", "<i8", ">i8", "<f2", ">f2", "<f4", ">f4", "<f8", ">f8", "<c8", "<M8[s]", "V3"):
        seeds.add("npz", "npy" + str(np.dtype(dtype).num) + dtype[0].replace("<", "l").replace(">", "b").replace("?", "o"),
                  npy(numbers.astype(dtype) if dtype != "V3" else np.zeros(2, "V3")))
    seeds.add("npz", "fortran", npy(np.asfortranarray(numbers.astype("<f4"))))
    seeds.add("npz", "fortran3", npy(np.asfortranarray(np.arange(24, dtype=">i4").reshape(2, 3, 4))))
    seeds.add("npz", "scalar", npy(np.float32(3)))
    seeds.add("npz", "empty", npy(np.zeros((0, 3), "<f4")))
    seeds.add("npz", "text", npy(np.array(["wörd", "b"])))
    seeds.add("npz", "bytes", npy(np.array([b"word", b"b"])))
    seeds.add("npz", "records", npy(np.zeros(2, [("a", "<i4"), ("b", "<f4")])))
    for version in (1, 2, 3):
        header = str({"descr": "<f4", "fortran_order": False, "shape": (2,)}).encode() + b"\n"
        size = struct.pack("<H", len(header)) if version == 1 else struct.pack("<I", len(header))
        seeds.add("npz", f"version{version}", b"\x93NUMPY" + bytes([version, 0]) + size + header + b"\0" * 8)
    for name, method in (("stored", zipfile.ZIP_STORED), ("deflated", zipfile.ZIP_DEFLATED)):
        out = io.BytesIO()
        with zipfile.ZipFile(out, "w", method) as archive:
            archive.writestr("a.npy", npy(numbers))
            archive.writestr("b.npy", npy(np.array(["text"])))
        seeds.add("npz", name + ".zip", out.getvalue())
        seeds.add("npz_objects", name + ".zip", out.getvalue())

    rig = {"name": "rig", "joints": np.ones((2, 3), "<f4"), "parents": [None, 0], "words": ("a", b"b"), "real": 1.5, "flag": True,
           "text": np.array(["a", "bc"]), "bytes": np.array([b"a"]), "scalar": np.float64(2), "whole": np.int64(3), "deep": {"a": {"b": [1.0, 2, True]}},
           "fortran": np.asfortranarray(np.ones((2, 2), ">f8")), "objects": np.array([{"x": 1}, None], object), "half": np.ones(2, "<f2"),
           "long": 1 << 40, "huge": 1 << 70, "mixed": [1, "a"], "names": {2: "b"}, "ragged": [[1, 2], [3]], "empty": [], "bool": [True, False]}
    several = np.empty(3, object)
    several[:] = [dict(rig, name=name) for name in ("a", "b", "rig")]
    for name, value in (("dict", rig), ("list", [rig, rig]), ("several", several), ("texts", np.array(["a", None], object)), ("number", 5)):
        array = value if isinstance(value, np.ndarray) else np.array(value, object) if not isinstance(value, list) else several
        seeds.add("npz_objects", name, npy(array, dtype=object))
    independent = np.empty(2, object)
    independent[:] = [{"name": name, "joints": np.full((3, 3), i, "<f8"), "faces": np.zeros((2, 3), "<i4"), "words": [name * 3, name * 4],
                       "long": "x" * 300, "bytes": b"y" * 300} for i, name in enumerate("pq")]
    seeds.add("npz_objects", "samples", npy(independent))
    seeds.add("npz_objects", "samples_in_list", npy(np.array([list(independent)], object).reshape(2)))
    seeds.add("npz_objects", "text", npy(np.array(["wörd", "b"])))
    seeds.add("npz_objects", "bytes", npy(np.array([b"word"])))

    values = [rig, several, [None, True, False, 1, -1, 255, 65536, -(1 << 31), 1 << 40, 1 << 70, -(1 << 70), 1.5], ("t",), (1, 2), (1, 2, 3), (1, 2, 3, 4), {1, 2},
              frozenset([1]), b"b", b"b" * 300, "s" * 300, "\u20ac\\\n'\"", collections.OrderedDict(a=1), np.dtype("<f4"), np.dtype(">i8"), np.dtype("U3"),
              np.float32(1), np.array(2.5), np.array([["a", "b"]]), bytearray(b"b")]
    shared = [1, 2]
    values.append([shared, shared, {"a": shared}])
    for protocol in range(6):
        for number, value in enumerate(values):
            seeds.add("pickle", f"{protocol}_{number}", pickle.dumps(value, protocol))


def torch_names():
    """Modules that have the names of PyTorch's, for pickles that refer to them."""
    modules = {name: types.ModuleType(name) for name in ("torch", "torch._utils")}

    def put(module, thing, name):
        thing.__module__, thing.__qualname__, thing.__name__ = module, name, name
        setattr(modules[module], name, thing)
        return thing

    storages = {name: put("torch", type(name, (), {}), name) for name in
                ("FloatStorage", "HalfStorage", "LongStorage", "BoolStorage", "BFloat16Storage", "DoubleStorage", "ByteStorage", "IntStorage")}
    rebuild = put("torch._utils", lambda *_: None, "_rebuild_tensor_v2")
    parameter = put("torch._utils", lambda *_: None, "_rebuild_parameter")
    size = put("torch", type("Size", (tuple,), {"__reduce__": lambda self: (size, (tuple(self),))}), "Size")
    device = put("torch", lambda *_: None, "device")
    sys.modules.update(modules)
    return storages, rebuild, parameter, size, device


class Made:
    """Pickled as the call of a function."""

    def __init__(self, function, *arguments):
        self.made = function, arguments

    def __reduce__(self):
        return self.made


def torch_archives(seeds):
    storages, rebuild, parameter, size, device = torch_names()

    class Storage:
        def __init__(self, kind, count):
            self.kind, self.count = kind, count

    # The archive of the target has a storage of six elements of each size.
    sizes_of = {"BoolStorage": "1", "ByteStorage": "1", "HalfStorage": "2", "BFloat16Storage": "2", "FloatStorage": "4", "IntStorage": "4"}

    class Pickler(pickle._Pickler):
        def persistent_id(self, thing):
            return ("storage", storages[thing.kind], sizes_of.get(thing.kind, "8"), "cpu", thing.count) if isinstance(thing, Storage) else None

    def tensor(kind="FloatStorage", count=6, offset=0, sizes=(2, 3), strides=(3, 1)):
        return Made(rebuild, Storage(kind, count), offset, sizes, strides, False, collections.OrderedDict())

    states = {"state": collections.OrderedDict([("model.weight", tensor()), ("model.bias", tensor(sizes=(3,), strides=(1,), offset=3))]),
              "transposed": {"w": tensor(sizes=(3, 2), strides=(1, 3)), "expanded": tensor(sizes=(4, 3), strides=(0, 1)), "scalar": tensor(sizes=(), strides=())},
              "checkpoint": {"state_dict": {"model.a": tensor(), "model.b": Made(parameter, tensor(), True, collections.OrderedDict())}, "epoch": 3,
                             "config": {"a": [1, 2.5, None, True, "t", (1, 2)], "b": {"c": {}}}, "size": Made(size, (2, 3))},
              "plain": [tensor("LongStorage", sizes=(2,), strides=(1,)), {"x": tensor("BoolStorage", sizes=(6,), strides=(1,))}],
              "device": {"d": Made(device, "cpu"), "w": tensor("BFloat16Storage")},
              "empty": {"e": tensor(sizes=(0, 3), strides=(3, 1))}}
    for kind in storages:
        states[kind] = {"w": tensor(kind)}
    for name, state in states.items():
        for protocol in (2, 4):
            out = io.BytesIO()
            Pickler(out, protocol).dump(state)
            seeds.add("torch", f"{name}{protocol}", out.getvalue())
            seeds.add("pickle", f"torch_{name}{protocol}", out.getvalue())
    out = io.BytesIO()
    Pickler(out, 2).dump(states["state"])
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr("archive/data.pkl", out.getvalue())
        file.writestr("archive/data/4", bytes(24))
        file.writestr("archive/version", "3\n")
    seeds.add("torch", "whole.zip", archive.getvalue())


def safetensors(seeds):
    header = {"__metadata__": {"made_by": "a test"}}
    end = 0
    for dtype, size in (("BOOL", 1), ("U8", 1), ("I8", 1), ("I16", 2), ("I32", 4), ("I64", 8), ("F16", 2), ("BF16", 2), ("F32", 4), ("F64", 8)):
        header["model." + dtype] = {"dtype": dtype, "shape": [2, 1], "data_offsets": [end, end + 2 * size]}
        end += 2 * size
    scalar = {"a": {"dtype": "F32", "shape": [], "data_offsets": [0, 4]}}
    # Of the last, a number beyond the largest double, found by fuzzing.
    for name, text, size in (("all", json.dumps(header), end), ("none", "{}", 0), ("scalar", json.dumps(scalar), 4), ("beyond", '{"a":31E872}', 0)):
        text = text.encode()
        seeds.add("safetensors", name, struct.pack("<Q", len(text)) + text + bytes(size))


def tiff(orientation, order="<"):
    """The head of a TIFF file, as EXIF has it: size, orientation."""
    entries = [(0x100, 3, 1, 2), (0x101, 4, 1, 2), (0x112, 3, 1, orientation)]
    body = b"".join(struct.pack(order + "HHI", tag, kind, count) + (struct.pack(order + "HH", value, 0) if kind == 3 else struct.pack(order + "I", value))
                    for tag, kind, count, value in entries)
    return (b"II*\0" if order == "<" else b"MM\0*") + struct.pack(order + "IH", 8, len(entries)) + body + bytes(4)


def png(width, height, kind, bits, rows, *chunks):
    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, kind, 0, 0, 0)) + b"".join(chunk(*c) for c in chunks) +
            chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def pictures(seeds):
    for name, text in PICTURES.items():
        seeds.add("image", name, base64.b64decode(text))
    jpeg = base64.b64decode(PICTURES["gray.jpg"])
    webp = base64.b64decode(PICTURES["lossless.webp"])
    for orientation in range(1, 9):
        exif = b"Exif\0\0" + tiff(orientation, "<>"[orientation % 2])
        seeds.add("image", f"turned{orientation}.jpg", jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + jpeg[2:])
        seeds.add("image", f"turned{orientation}.png", png(2, 2, 2, 8, (b"\0" + bytes(range(6))) * 2, (b"eXIf", tiff(orientation))))
    exif = tiff(6) + b"\0" * (len(tiff(6)) % 2)
    extended = b"VP8X" + struct.pack("<IB3x", 10, 8) + (4).to_bytes(3, "little") + (2).to_bytes(3, "little")
    chunks = b"WEBP" + extended + webp[12:] + b"EXIF" + struct.pack("<I", len(exif)) + exif
    seeds.add("image", "turned.webp", b"RIFF" + struct.pack("<I", len(chunks)) + chunks)
    for kind, channels in ((0, 1), (2, 3), (4, 2), (6, 4)):
        for bits in (8, 16):
            seeds.add("image", f"kind{kind}_{bits}.png", png(2, 2, kind, bits, (b"\0" + bytes(range(2 * channels * bits // 8))) * 2))
    seeds.add("image", "palette.png", png(2, 2, 3, 8, b"\0\0\1\0\1\0", (b"PLTE", bytes(range(6))), (b"tRNS", b"\0")))
    seeds.add("image", "one_bit.png", png(8, 2, 0, 1, b"\0\xaa\0\x55"))
    seeds.add("image", "plain.bmp", b"BM" + struct.pack("<IIIIiiHHIIiiII", 70, 0, 54, 40, 2, 2, 1, 24, 0, 16, 0, 0, 0, 0) + bytes(16))
    seeds.add("image", "flipped.bmp", b"BM" + struct.pack("<IIIIiiHHIIiiII", 70, 0, 54, 40, 2, -2, 1, 32, 0, 16, 0, 0, 0, 0) + bytes(16))
    for order in "<>":
        entries = [(0x100, 3, 2), (0x101, 3, 2), (0x102, 3, 8), (0x103, 3, 1), (0x106, 3, 1), (0x111, 4, 134), (0x112, 3, 6), (0x115, 3, 1), (0x116, 3, 2), (0x117, 4, 4)]
        body = b"".join(struct.pack(order + "HHI", tag, kind, 1) + (struct.pack(order + "HH", value, 0) if kind == 3 else struct.pack(order + "I", value))
                        for tag, kind, value in entries)
        seeds.add("image", "little.tif" if order == "<" else "big.tif",
                  (b"II*\0" if order == "<" else b"MM\0*") + struct.pack(order + "IH", 8, len(entries)) + body + bytes(4) + b"\1\2\3\4")


def three_mf(seeds):
    mesh = '<mesh><vertices><vertex x="0" y="0" z="0"/><vertex x="1" y="0" z="0"/><vertex x="0" y="1" z="0"/></vertices><triangles><triangle v1="0" v2="1" v3="2"/></triangles></mesh>'
    for unit in ("micron", "millimeter", "centimeter", "inch", "foot", "meter"):
        model = (f'<?xml version="1.0"?><!-- a --><model unit="{unit}" xmlns="x"><resources><basematerials id="9"><base name="a &amp; b" displaycolor="#FF0000"/></basematerials>'
                 f'<object id="1" type="model">{mesh}</object><object id="2" type="support">{mesh}</object>'
                 '<object id="3"><components><component objectid="1" transform="1 0 0 0 1 0 0 0 1 5 6 7"/><component objectid="1"/></components></object></resources>'
                 '<build><item objectid="3" transform="2 0 0 0 -2 0 0 0 2 0 0 0"/><item objectid="1"/></build></model>')
        seeds.add("three_mf", unit, model)
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr("_rels/.rels", '<Relationships><Relationship Target="/3D/a.model" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>')
        file.writestr("3D/a.model", model)
    seeds.add("three_mf", "whole.zip", archive.getvalue())


def gltf(seeds):
    """One triangle and a joint, in the forms that glTF has for each of their parts."""
    def view(data, views, binary):
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(data)})
        binary += data + bytes(-len(data) % 4)
        return len(views) - 1

    def scene(name, change=None, primitive=None, mode=None, colors=None, uri=True, sparse=False, joints=np.uint8, weights=np.float32, indices=np.uint16):
        views, binary, accessors = [], bytearray(), []

        def accessor(array, kind, normalized=False, **more):
            codes = {"int8": 5120, "uint8": 5121, "int16": 5122, "uint16": 5123, "uint32": 5125, "float32": 5126}
            entry = {"bufferView": view(np.ascontiguousarray(array).tobytes(), views, binary), "componentType": codes[array.dtype.name], "count": len(array), "type": kind, **more}
            if normalized:
                entry["normalized"] = True
            accessors.append(entry)
            return len(accessors) - 1

        def unit(values, dtype):
            return np.asarray(values, np.float32) if dtype == np.float32 else np.asarray(np.asarray(values) * np.iinfo(dtype).max, dtype)

        points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], np.float32)
        attributes = {"POSITION": accessor(points, "VEC3", min=[0, 0, 0], max=[1, 1, 0]), "NORMAL": accessor(np.array([[0, 0, 1]] * 4, np.float32), "VEC3"),
                      "TEXCOORD_0": accessor(points[:, :2].copy(), "VEC2"),
                      "JOINTS_0": accessor(np.array([[0, 1, 0, 0]] * 4, joints), "VEC4"),
                      "WEIGHTS_0": accessor(unit([[0.5, 0.5, 0, 0]] * 4, weights), "VEC4", weights != np.float32)}
        if colors:
            dtype, channels = colors
            attributes["COLOR_0"] = accessor(unit([[1, 0.5, 0, 1][:channels]] * 4, dtype), f"VEC{channels}", dtype != np.float32)
        part = {"attributes": attributes, "indices": accessor(np.array([0, 1, 2, 3], indices) if mode in (4, None) and False else
                                                              np.array([0, 1, 2, 2, 1, 3] if mode in (4, None) else [0, 1, 2, 3], indices), "SCALAR"), "material": 0}
        if mode is not None:
            part["mode"] = mode
        part.update(primitive or {})
        if sparse:
            accessors[0]["sparse"] = {"count": 1, "indices": {"bufferView": view(b"\1\0", views, binary), "componentType": 5123},
                                      "values": {"bufferView": view(np.array([2, 0, 0], "<f4").tobytes(), views, binary)}}
        inverse = np.tile(np.eye(4, dtype=np.float32).reshape(1, 16), (2, 1))
        times = accessor(np.array([0, 1], np.float32), "SCALAR", min=[0], max=[1])
        turn = np.array([[0, 0, 0, 1], [0, 0, 1, 0]], np.float32)
        samplers = [{"input": times, "output": accessor(turn, "VEC4"), "interpolation": "LINEAR"},
                    {"input": times, "output": accessor(np.zeros((6, 3), np.float32), "VEC3"), "interpolation": "CUBICSPLINE"},
                    {"input": times, "output": accessor(np.ones((2, 3), np.float32), "VEC3"), "interpolation": "STEP"},
                    {"input": times, "output": accessor(unit(turn, np.int16), "VEC4", True)}]
        channels = [{"sampler": 0, "target": {"node": 1, "path": "rotation"}}, {"sampler": 1, "target": {"node": 1, "path": "translation"}},
                    {"sampler": 2, "target": {"node": 1, "path": "scale"}}, {"sampler": 3, "target": {"node": 2, "path": "rotation"}}]
        picture = png(2, 2, 6, 8, (b"\0" + bytes(range(8))) * 2)
        images = [{"uri": "data:image/png;base64," + base64.b64encode(picture).decode()}, {"bufferView": view(picture, views, binary), "mimeType": "image/png"}]
        document = {"asset": {"version": "2.0", "generator": "a test", "copyright": "CC0"}, "scene": 0, "scenes": [{"nodes": [0, 1]}],
                    "nodes": [{"mesh": 0, "skin": 0}, {"name": "a", "children": [2], "translation": [0, 0, 0]},
                              {"name": "b", "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0.5, 0, 0, 1]}],
                    "meshes": [{"primitives": [part], "name": "m"}],
                    "skins": [{"joints": [1, 2], "inverseBindMatrices": accessor(inverse, "MAT4"), "skeleton": 1}],
                    "animations": [{"name": "turn", "samplers": samplers, "channels": channels}],
                    "materials": [{"name": "red", "pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1], "metallicFactor": 0.5, "roughnessFactor": 0.5, "baseColorTexture": {
                        "index": 0, "extensions": {"KHR_texture_transform": {"offset": [0.5, 0], "scale": [2, 2], "rotation": 0.5}}}},
                        "normalTexture": {"index": 1, "scale": 0.5}, "occlusionTexture": {"index": 0, "strength": 0.5}, "emissiveTexture": {"index": 1}, "emissiveFactor": [1, 1, 1],
                        "alphaMode": "MASK", "alphaCutoff": 0.25, "doubleSided": True, "extensions": {"KHR_materials_unlit": {}}}],
                    "textures": [{"source": 0, "sampler": 0}, {"source": 1}], "images": images, "samplers": [{"magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33648}],
                    "accessors": accessors, "bufferViews": views, "extensionsUsed": ["KHR_texture_transform", "KHR_materials_unlit"]}
        document["buffers"] = [{"byteLength": len(binary)}]
        if change:
            change(document)
        text = json.dumps(document, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        seeds.add("glb", name, b"glTF" + struct.pack("<III", 2, 28 + len(text) + len(binary), len(text)) + b"JSON" + text + struct.pack("<I", len(binary)) + b"BIN\0" + bytes(binary))
        if uri:
            document["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(bytes(binary)).decode()
            seeds.add("gltf", name, json.dumps(document))

    scene("plain")
    for mode in range(7):
        scene(f"mode{mode}", mode=mode)
    for number, colors in enumerate(((np.uint8, 3), (np.uint8, 4), (np.uint16, 3), (np.uint16, 4), (np.float32, 3), (np.float32, 4))):
        scene(f"colors{number}", colors=colors)
    scene("sparse", sparse=True)
    scene("wide", joints=np.uint16, weights=np.uint16, indices=np.uint32)
    scene("narrow", weights=np.uint8, indices=np.uint8)
    scene("no_indices", change=lambda d: d["meshes"][0]["primitives"][0].pop("indices"))
    scene("no_skin", change=lambda d: (d["nodes"][0].pop("skin"), d.pop("skins")))
    scene("animated_nodes", change=lambda d: (d["nodes"][0].pop("skin"), d.pop("skins"), d["nodes"][1].update(mesh=0)))
    scene("two_skins", change=lambda d: (d["skins"].append({"joints": [2]}), d["nodes"].append({"mesh": 0, "skin": 1}), d["scenes"][0]["nodes"].append(3)))
    scene("no_scene", change=lambda d: (d.pop("scene"), d.pop("scenes")))
    scene("morph", primitive={"targets": [{"POSITION": 0}]})
    scene("required", change=lambda d: d.update(extensionsRequired=["KHR_unknown"]))
    scene("outside", uri=False, change=lambda d: d["images"][0].update(uri="../a.png"))
    scene("beside", uri=False, change=lambda d: d["images"][0].update(uri="a%20b.png"))
    scene("stride", change=lambda d: d["bufferViews"][0].update(byteStride=12))


def draco(seeds):
    encoder = shutil.which("draco_encoder")
    if not encoder:
        return
    with tempfile.TemporaryDirectory() as place:
        mesh, packed = pathlib.Path(place) / "a.obj", pathlib.Path(place) / "a.drc"
        side = 4
        corners = "".join(f"v {x} {y} {x * y % 3}\nvt {x / side} {y / side}\nvn 0 0 1\n" for y in range(side) for x in range(side))
        faces = "".join(f"f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}\n" for y in range(side - 1) for x in range(side - 1)
                        for i in [1 + y * side + x] for a, b, c in ((i, i + 1, i + side), (i + 1, i + side + 1, i + side)))
        mesh.write_text(corners + faces)
        for level in (0, 1, 3, 5, 7, 10):
            for bits in (0, 4, 11):
                subprocess.run([encoder, "-i", mesh, "-o", packed, "-cl", str(level), "-qp", str(bits), "-qt", str(bits), "-qn", str(bits)],
                               check=True, stdout=subprocess.DEVNULL)
                for vertices, triangles in ((side * side, 2 * (side - 1) ** 2), (1, 1)):
                    seeds.add("draco", f"{level}_{bits}_{vertices}", struct.pack("<HH", vertices - 1, triangles - 1) + packed.read_bytes())


def requests(seeds):
    def post(name, path, body, kind="application/json"):
        body = body if isinstance(body, bytes) else json.dumps(body).encode()
        seeds.add("http", name, f"POST {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: {kind}\r\nContent-Length: {len(body)}\r\n\r\n".encode() + body)

    def form(name, path, *parts):
        body = b"".join(b'--b\r\nContent-Disposition: form-data; name="' + part.encode() + b'"' + (f'; filename="{file}"'.encode() if file else b"") + b"\r\n\r\n" +
                        (data if isinstance(data, bytes) else data.encode()) + b"\r\n" for part, file, data in parts) + b"--b--\r\n"
        post(name, path, body, "multipart/form-data; boundary=b")

    joints = [{"name": "base", "parent": -1, "position": [-0.5, 0, 0]}, {"name": "lid", "parent": 0, "position": [0, 0, 0]}]
    moved = [joints[0], dict(joints[1], position=[0.1, 0, 0], was="lid"), {"name": "end", "parent": 1, "position": [1, 0, 0]}]
    strokes = [{"joint": "lid", "center": [0, 0, 0], "radius": 0.5, "mode": mode, "strength": 0.5} for mode in ("add", "remove", "smooth")]
    for method in ("heat", "geovoxel", "nearest", "keep"):
        post(f"rebind_{method}", "/v1/jobs/j000001/rebind", {"joints": joints, "method": method, "strokes": strokes})
        post(f"moved_{method}", "/v1/jobs/j000001/rebind", {"joints": moved, "method": method, "draft": True})
    for number, stroke in enumerate(strokes):
        post(f"stroke{number}", "/v1/jobs/j000001/rebind", {"joints": joints, "method": "keep", "strokes": [dict(stroke, radius=10, strength=1)]})
    for names in ("chain", "mixamo", "vrm", "unreal", "unity", "blender", "rigify", "godot"):
        post(f"names_{names}", "/v1/jobs/j000001/rename", {"names": names})
    mesh = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    rig = {"method": "auto", "skin": "heat", "templates": ["snake", "biped"], "keep_skeleton": False, "joints": 5, "symmetric": True, "influences": 8, "names": "mixamo",
           "motions": ["idle"]}
    form("rig", "/v1/3d/rigs", ("file", "a.obj", mesh), ("options", "", json.dumps(rig)))
    form("rig_of_job", "/v1/3d/rigs", ("job", "", "j000001"), ("options", "", json.dumps({"method": "nearest"})))
    form("animation", "/v1/3d/animations", ("file", "a.glb", b"glTF"), ("options", "", json.dumps({"motions": ["walk"], "fps": 24, "travel": True})))
    form("evaluation", "/v1/3d/evaluations", ("job", "", "j000001"), ("truth", "b.glb", b"glTF"),
         ("options", "", json.dumps({"protocol": "anigen", "groups": ["skeleton"], "registration": False})))
    form("generation", "/v1/3d/generations", ("file", "a.png", png(2, 2, 2, 8, (b"\0" + bytes(6)) * 2)),
         ("options", "", json.dumps({"seed": 1, "ss_steps": 2, "slat_steps": 2, "joints": 5, "stop_at": "voxels", "motions": []})))
    voxels = npy(np.zeros((4, 3), "<i4"))
    form("voxels", "/v1/3d/generations", ("file", "a.png", b"\x89PNG"), ("voxels", "voxels.npz", voxels), ("options", "", json.dumps({"voxels_of": "j000001"})))
    post("compare", "/v1/jobs/j000001/compare", {"methods": ["nearest", "heat"]})
    form("second_run", "/v1/3d/generations", ("options", "", json.dumps({"voxels_of": "j000002", "seed": 3})))
    for number, line in enumerate(("Cookie: anigen_token=right", "Authorization: Bearer right", "Authorization: Bearer wrong token")):
        seeds.add("http", f"guarded{number}", f"GET /v1/jobs?token HTTP/1.1\r\nHost: 127.0.0.1\r\n{line}\r\n\r\n")
    for number, path in enumerate(("/?token=right", "/index.html", "/three/studio.css", "/gallery/deer.png", "/gallery/../x", "/openapi.json", "/v1/studio",
                                   "/v1/jobs/j000002", "/v1/jobs/j000002/files/voxels.npz")):
        seeds.add("http", f"page{number}", f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
    seeds.add("http", "resumed", "GET /v1/jobs/j000001/events HTTP/1.1\r\nHost: 127.0.0.1\r\nLast-Event-ID: 1\r\nAccept: text/event-stream\r\n\r\n")
    seeds.add("http", "part", "GET /v1/jobs/j000001/files/rigged.glb HTTP/1.1\r\nHost: localhost\r\nRange: bytes=0-9\r\nIf-None-Match: *\r\n\r\n")


def experiment(seeds):
    steps = {"dataset": {"program": "anigen-prepare", "args": {"--procedural": 2}, "minutes": 5, "megabytes": 10, "resources": {
                 "workers": 2, "cpus": 4, "gpus": 1, "memory_gb": 8, "hours": 1.5, "partition": "p"}},
             "train": {"program": "anigen-train", "config": "../../configs/tiny/skin_ae.json", "args": {"--dataset": "{dataset}"},
                       "set": {"trainer": {"args": {"max_steps": 5}}, "a.b": [1, 2]}, "after": ["dataset"]},
             "scores": {"program": "anigen-eval", "args": {"--skin-ae": "{train}", "--dataset": "{dataset}"}}}
    whole = {"title": "A", "purpose": "a test", "steps": steps, "seeds": [0, 1], "seeded": ["train"],
             "grid": [{"step": "train", "set": "trainer.args.lr", "values": [1, "x"], "label": "rate"}, {"step": "train", "set": "a.c", "values": [1]}],
             "scales": {"tiny": {"steps": {"train": {"set": {"trainer.args.max_steps": 1}}}}, "file": "../tiny_full.json"},
             "tables": [{"title": "Scores", "step": "scores", "columns": [{"key": "l1", "better": "lower"}]}]}
    for name, left_out in (("all", ()), ("no_seeds", ("seeds", "seeded", "scales")), ("no_grid", ("grid", "seeds", "seeded", "scales")), ("scale", ("seeds", "seeded", "grid"))):
        seeds.add("experiment", name, json.dumps({key: value for key, value in whole.items() if key not in left_out}))
    variants = {key: value for key, value in whole.items() if key not in ("grid", "seeds", "seeded", "scales")}
    seeds.add("experiment", "variants", json.dumps(dict(variants, variants={"a": {"train": {"set": {"x": 1}}}, "b": {"dataset": {"args": {"--procedural": 3}}}, "c": None})))
    seeds.add("experiment", "extended", json.dumps({"extends": "../tiny_full.json", "variants": {"a": {"skin_ae": {"minutes": 1}}}}))


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    seeds = Seeds(pathlib.Path(sys.argv[1]))
    seeds.add("obj", "all", OBJ)
    seeds.add("mtl", "all", MTL)
    seeds.add("text_rig", "all", TEXT_RIG)
    seeds.add("json", "all", json.dumps(CONFIG))
    for number, (key, value) in enumerate(CONFIG.items()):
        seeds.add("json", f"{number}", json.dumps({key: value}))
    for make in (arrays, torch_archives, safetensors, pictures, three_mf, gltf, draco, requests, experiment):
        make(seeds)


if __name__ == "__main__":
    main()
