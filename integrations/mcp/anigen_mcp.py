#!/usr/bin/env python3
"""Tools of a running anigen-studio for programs that speak the Model Context Protocol, over standard input and output.

    anigen_mcp.py [--address http://127.0.0.1:8080/]

Tools: generate, rig, animate, evaluate, lint, job_status, cancel. They take and write files of this machine, and wait for
their job unless told not to; a client that asks for progress gets it. The address is that which anigen-studio prints, by
default $ANIGEN_STUDIO; its token, where it has one, is part of it or $ANIGEN_TOKEN. Needs Python 3.7 and nothing else.

Messages are JSON-RPC 2.0, one a line. Diagnostics go to standard error."""
import argparse
import http.client
import json
import os
import re
import secrets
import sys
import tempfile
import threading
import time
import urllib.parse

NAME, VERSION = "anigen", "0.2.0"
PROTOCOLS = ["2025-11-25", "2025-06-18", "2025-03-26", "2024-11-05"]  # the newest first
ENDED = ("done", "failed", "cancelled")
RESULTS = (".glb", ".fbx", ".usdz", ".vrm", ".zip")
PARSE_ERROR, INVALID_REQUEST, NO_SUCH_METHOD, INVALID_PARAMS, INTERNAL_ERROR = -32700, -32600, -32601, -32602, -32603


class ToolError(Exception):
    """A sentence for whoever called a tool."""


class RpcError(Exception):
    """A call that is none. @param code of JSON-RPC"""

    def __init__(self, code, message):
        super().__init__(message)
        self.code = code


class Cancelled(Exception):
    """The client no longer wants the answer."""


class Studio:
    """The HTTP routes of a studio."""

    def __init__(self, address, token):
        parts = urllib.parse.urlsplit(address if "://" in address else "http://" + address)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise ValueError(f"{address!r} is no address such as http://127.0.0.1:8080/")
        self.host, self.port, self.secure = parts.hostname, parts.port, parts.scheme == "https"
        self.shown = f"{parts.scheme}://{parts.netloc}/"
        self.prefix = parts.path.rstrip("/")
        self.token = token or urllib.parse.parse_qs(parts.query).get("token", [""])[0]

    def ask(self, method, path, body=None, content_type=None):
        """@return the response's body @raises ToolError with what the studio says"""
        kind = http.client.HTTPSConnection if self.secure else http.client.HTTPConnection
        connection = kind(self.host, self.port, timeout=600)
        headers = {"Content-Type": content_type} if content_type else {}
        if self.token:
            headers["Authorization"] = "Bearer " + self.token
        if method == "POST" and body is None:
            body = b""
        try:
            connection.request(method, self.prefix + path, body, headers)
            answer = connection.getresponse()
            content = answer.read()
        except (OSError, http.client.HTTPException) as error:
            raise ToolError(f"no studio answers at {self.shown} ({error}): start anigen-studio, or name its address by "
                            "--address or ANIGEN_STUDIO") from error
        finally:
            connection.close()
        if answer.status >= 400:
            try:
                said = json.loads(content)["error"]
            except (ValueError, KeyError, TypeError):
                said = content[:200].decode("utf-8", "replace")
            raise ToolError(f"{said} (HTTP {answer.status})")
        return content

    def json(self, method, path, body=None, content_type=None):
        content = self.ask(method, path, body, content_type)
        try:
            return json.loads(content)
        except ValueError as error:
            raise ToolError(f"{self.shown} answers no JSON: is it an anigen-studio?") from error

    def submit(self, kind, files, fields):
        """A new job. @param files name of the part to path @param fields name of the part to text"""
        boundary = secrets.token_hex(16)
        body = b""
        for part, path in files.items():
            name = re.sub(r'["\r\n]', "_", os.path.basename(path))
            body += (f'--{boundary}\r\nContent-Disposition: form-data; name="{part}"; filename="{name}"\r\n'
                     "Content-Type: application/octet-stream\r\n\r\n").encode("utf-8", "replace") + contents(path) + b"\r\n"
        for part, text in fields.items():
            body += f'--{boundary}\r\nContent-Disposition: form-data; name="{part}"\r\n\r\n{text}\r\n'.encode()
        body += f"--{boundary}--\r\n".encode()
        return self.json("POST", f"/v1/3d/{kind}", body, f"multipart/form-data; boundary={boundary}")

    def job(self, job):
        return self.json("GET", "/v1/jobs/" + job)

    def end(self, job):
        return self.json("DELETE", "/v1/jobs/" + job)


def contents(path):
    try:
        with open(os.path.expanduser(path), "rb") as file:
            return file.read()
    except OSError as error:
        raise ToolError(f"{path}: cannot be read: {error.strerror}") from error


def check_output(arguments):
    """Refuses, before a job begins, a place where its result cannot be written."""
    path = arguments.get("output")
    if not path:
        return
    path = os.path.expanduser(path)
    if os.path.splitext(path)[1].lower() not in RESULTS:
        raise ToolError(f"{path}: results end in {', '.join(RESULTS)}")
    if os.path.exists(path) and not arguments.get("overwrite"):
        raise ToolError(f"{path}: is there already; overwrite says that it may be replaced")
    folder = os.path.dirname(os.path.abspath(path))
    if not os.path.isdir(folder):
        raise ToolError(f"{folder}: no such folder")


def write_result(studio, job, arguments):
    """Writes the rig of a job to `output`, whole or not at all. @return its path"""
    path = os.path.abspath(os.path.expanduser(arguments["output"]))
    name = ("edited" if job.get("edited") else "rigged") + os.path.splitext(path)[1].lower()
    content = studio.ask("GET", f"/v1/jobs/{job['id']}/files/{name}")
    try:
        descriptor, temporary = tempfile.mkstemp(dir=os.path.dirname(path), prefix=".anigen-")
        try:
            with os.fdopen(descriptor, "wb") as file:
                file.write(content)
            umask = os.umask(0)
            os.umask(umask)
            os.chmod(temporary, 0o666 & ~umask)
            os.replace(temporary, path)
        except BaseException:
            os.unlink(temporary)
            raise
    except OSError as error:
        raise ToolError(f"{path}: cannot be written: {error.strerror}") from error
    return path


def summary(job):
    """The members of a job that say how it stands."""
    keys = ("id", "kind", "name", "state", "stage", "fraction", "seconds_left", "note", "error", "result", "scores",
            "pictures")
    return {key: job[key] for key in keys if job.get(key) not in (None, "", [], {})}


class Call:
    """A call of a tool while it goes on."""

    def __init__(self, server, studio, token):
        self.server, self.studio, self.token = server, studio, token
        self.cancelled = threading.Event()
        self.told = 0.0

    def progress(self, job):
        """Tells how far a job is, where the client asked; the number is of stages and grows."""
        if self.token is None:
            return
        value = max(0, len(job.get("stages") or []) - 1) + float(job.get("fraction") or 0.0)
        if value <= self.told:
            return
        self.told = value
        left = job.get("seconds_left")
        message = f"{job.get('stage') or job['state']}, {100 * float(job.get('fraction') or 0.0):.0f} %"
        if left is not None:
            message += f", {left:.0f} s left"
        self.server.notify("notifications/progress",
                           {"progressToken": self.token, "progress": value, "message": message})

    def wait(self, job, own=True):
        """@param own this call has begun the job, and ends it when it is cancelled itself
        @return the job that has ended @raises Cancelled after it was cancelled; ToolError when it failed"""
        pause = 0.05
        while job["state"] not in ENDED:
            if self.cancelled.wait(pause):
                try:
                    # Ending a job that has ended removes it with its files.
                    if own and self.studio.job(job["id"])["state"] not in ENDED:
                        self.studio.end(job["id"])
                except ToolError as error:
                    print(f"anigen_mcp: {error}", file=sys.stderr)
                raise Cancelled()
            pause = min(0.5, pause * 1.5)
            job = self.studio.job(job["id"])
            self.progress(job)
        if job["state"] != "done":
            raise ToolError(f"job {job['id']} {job['state']}: {job.get('error') or 'no reason is known'}")
        return job

    def run(self, kind, files, arguments, words, fields=None):
        """A new job, and its result unless the caller does not wait. @param words that are options of the job"""
        check_output(arguments)
        options = {word: arguments[word] for word in words if word in arguments}
        job = self.studio.submit(kind, files, dict(fields or {}, options=json.dumps(options)))
        if not arguments.get("wait", True):
            return summary(job)
        return self.ended(self.wait(job), arguments)

    def ended(self, job, arguments):
        result = summary(job)
        if arguments.get("output"):
            result["output"] = write_result(self.studio, job, arguments)
        return result

    def source(self, arguments, part):
        """Of a tool that takes a job or a file in its place. @return (files, fields) of a form"""
        if ("job" in arguments) == (part in arguments):
            raise ToolError(f"name either a job or {part}")
        if "job" in arguments:
            return {}, {"job": job_id(arguments)}
        return {"file": arguments[part]}, {}


def job_id(arguments):
    if not re.fullmatch(r"[A-Za-z0-9]+", arguments["job"]):
        raise ToolError(f"{arguments['job']!r} is no ID of a job")
    return arguments["job"]


def generate(call, arguments):
    if "image" not in arguments and "voxels_of" not in arguments:
        raise ToolError("name an image, or in voxels_of a job whose image and voxels to go on from")
    if "stop_at" in arguments and "output" in arguments:
        raise ToolError("a generation that stops at its voxels has no asset to write")
    files = {part: arguments[name] for part, name in (("file", "image"), ("mask", "mask")) if name in arguments}
    options = ("seed", "joints", "ss_steps", "slat_steps", "motions", "stop_at", "voxels_of")
    return call.run("generations", files, arguments, options)


def rig(call, arguments):
    words = ("method", "skin", "templates", "keep_skeleton", "joints", "symmetric", "influences", "names", "motions")
    return call.run("rigs", {"file": arguments["mesh"]}, arguments, words)


def animate(call, arguments):
    files, fields = call.source(arguments, "asset")
    if "motion" in arguments:
        files["motion"] = arguments["motion"]
    return call.run("animations", files, arguments, ("motions", "fps", "travel"), fields)


def evaluate(call, arguments):
    files, fields = call.source(arguments, "prediction")
    files["truth"] = arguments["truth"]
    return call.run("evaluations", files, arguments, ("groups", "protocol", "registration"), fields)


def lint(call, arguments):
    files, fields = call.source(arguments, "asset")
    if fields:
        job = fields["job"]
    else:  # the studio checks what is in it: an animation by no motion is the asset as it is
        made = call.studio.submit("animations", files, {"options": json.dumps({"motions": []})})
        job = call.wait(made)["id"]
    try:
        return dict(call.studio.json("POST", f"/v1/jobs/{job}/lint"), job=job)
    finally:
        if not fields:
            call.studio.end(job)


def job_status(call, arguments):
    check_output(arguments)
    job = call.studio.job(job_id(arguments))
    if arguments.get("wait", False):
        job = call.wait(job, own=False)
    if job["state"] != "done":
        if arguments.get("output"):
            raise ToolError(f"job {job['id']} is {job['state']}, and has no result yet")
        return summary(job)
    return call.ended(job, arguments)


def cancel(call, arguments):
    job = call.studio.job(job_id(arguments))
    if job["state"] in ENDED:  # ending it once more would remove it and its files
        raise ToolError(f"job {job['id']} is {job['state']} already")
    return summary(call.studio.end(job["id"]))


def text(description, **more):
    return dict({"type": "string", "description": description}, **more)


def whole(description, least=0):
    return {"type": "integer", "minimum": least, "description": description}


def flag(description):
    return {"type": "boolean", "description": description}


def words(description):
    return {"type": "array", "items": {"type": "string"}, "description": description}


OUTPUT = {"output": text(f"File to write the result to: {' '.join(RESULTS)}, by its ending"),
          "overwrite": flag("Replace output where it is there already")}
WAIT = {"wait": flag("Wait for the end (the default); false: answer with the job at once, for job_status")}
MOTIONS = {"motions": words("Built-in motions, such as idle, walk; left out: all that the body can do; []: none")}
JOB = {"job": text("ID of a job whose result it is, in place of the file")}

# Name to (function, description, properties, required ones).
TOOLS = {
    "generate": (generate, "Makes a rigged, animated 3D asset of an image of one object or creature.",
                 {"image": text("Image file: PNG, JPEG, WebP, BMP, TIFF"), **OUTPUT,
                  "mask": text("PNG of the same size: the object is where it is bright"),
                  "seed": whole("Another seed, another asset"), "joints": whole("Wanted number; 0: as many as fit"),
                  "ss_steps": whole("Steps of the first flow", 1), "slat_steps": whole("Steps of the second flow", 1),
                  "stop_at": text('"voxels": ends after the first flow, whose picture the studio shows'),
                  "voxels_of": text("ID of a generation whose voxels to go on from, and its image where none is named"),
                  **MOTIONS, **WAIT}, []),
    "rig": (rig, "Gives a mesh a skeleton and skin weights.",
            {"mesh": text("Mesh file: glb, gltf, fbx, dae, obj, ply, stl, 3mf"), **OUTPUT,
             "method": text("auto, curve, pinocchio; nearest, geovoxel, heat for joints that the mesh has"),
             "skin": text("Weights by nearest, geovoxel or heat; left out: as the method says"),
             "templates": words("Species to try, such as fox"),
             "keep_skeleton": flag("Joints that the mesh has stay (the default)"),
             "joints": whole("Exactly so many; 0: as many as there are"), "symmetric": flag("Left and right mirror"),
             "influences": whole("Joints per vertex", 1), "names": text("chain, vrm, mixamo, unreal or unity"),
             **MOTIONS, **WAIT}, ["mesh"]),
    "animate": (animate, "Adds clips to a rigged asset: built-in motions, or the motion of another file.",
                {"asset": text("Rigged file: glb, gltf, fbx, dae"), **JOB, **OUTPUT,
                 "motion": text("File whose motion to take: bvh, fbx, dae, glb, gltf"), **MOTIONS,
                 "fps": {"type": "number", "description": "Key frames per second"},
                 "travel": flag("Walk, run, swim, fly and slither go forward"), **WAIT}, []),
    "evaluate": (evaluate, "Compares a rig with a true one by the metrics of anigen-eval.",
                 {"prediction": text("Rigged file"), **JOB, "truth": text("Rigged file to compare with"),
                  "groups": words("Of skeleton, transport, skin, surface, image, motion, anymate, soundness"),
                  "protocol": text("Of another paper, such as magicarticulate"),
                  "registration": flag("Register the prediction to the truth by ICP (the default)"), **WAIT}, ["truth"]),
    "lint": (lint, "Finds what is wrong with a rig: weights, joints, names, axes, poses.",
             {"asset": text("Rigged file: glb, gltf, fbx, dae"), **JOB}, []),
    "job_status": (job_status, "How a job stands; with output its result, when it is done.",
                   {"job": text("ID of the job"), **OUTPUT, "wait": flag("Wait for its end")}, ["job"]),
    "cancel": (cancel, "Cancels a job that waits or runs.", {"job": text("ID of the job")}, ["job"]),
}
TYPES = {"string": str, "integer": int, "number": (int, float), "boolean": bool, "array": list}


def check_arguments(tool, arguments):
    """@raises RpcError unless the arguments are those of the tool's schema"""
    if not isinstance(arguments, dict):
        raise RpcError(INVALID_PARAMS, "arguments is no object")
    _, _, properties, required = TOOLS[tool]
    for name in required:
        if name not in arguments:
            raise RpcError(INVALID_PARAMS, f"{tool} needs {name}")
    for name, value in arguments.items():
        if name not in properties:
            raise RpcError(INVALID_PARAMS, f"{tool} has no argument {name}")
        schema = properties[name]
        fits = isinstance(value, TYPES[schema["type"]]) and (schema["type"] == "boolean" or not isinstance(value, bool))
        if fits and schema["type"] == "array":
            fits = all(isinstance(item, str) for item in value)
        if not fits or (schema["type"] == "integer" and value < schema.get("minimum", value)):
            least = f" of {schema['minimum']} or more" if "minimum" in schema else ""
            raise RpcError(INVALID_PARAMS, f"{tool}: {name} is no {schema['type']}{least}")


class Server:
    """Reads requests and answers them; calls of tools go on side by side."""

    def __init__(self, studio, out):
        self.studio, self.out = studio, out
        self.lock = threading.Lock()
        self.calls = {}

    def send(self, message):
        line = json.dumps(dict({"jsonrpc": "2.0"}, **message)) + "\n"
        with self.lock:
            self.out.write(line.encode())
            self.out.flush()

    def notify(self, method, params):
        self.send({"method": method, "params": params})

    def fail(self, request, code, message):
        self.send({"id": request, "error": {"code": code, "message": message}})

    def take(self, line):
        """One line from the client."""
        try:
            message = json.loads(line)
        except (ValueError, RecursionError):
            return self.fail(None, PARSE_ERROR, "the line is no JSON")
        if not isinstance(message, dict) or message.get("jsonrpc") != "2.0":
            return self.fail(None, INVALID_REQUEST, "the line is no message of JSON-RPC 2.0")
        method, params = message.get("method"), message.get("params", {})
        if not isinstance(method, str):
            if "result" not in message and "error" not in message:  # else an answer, and nothing was asked
                self.fail(message.get("id"), INVALID_REQUEST, "the message has no method")
            return None
        if "id" not in message:
            return self.notified(method, params)
        request = message["id"]
        if not isinstance(request, (str, int)) or isinstance(request, bool):
            return self.fail(None, INVALID_REQUEST, "the id is neither text nor a whole number")
        try:
            if not isinstance(params, dict):
                raise RpcError(INVALID_PARAMS, "params is no object")
            self.answer(request, method, params)
        except RpcError as error:
            self.fail(request, error.code, str(error))
        return None

    def notified(self, method, params):
        if method == "notifications/cancelled" and isinstance(params, dict):
            with self.lock:
                call = self.calls.get(json.dumps(params.get("requestId")))
            if call:
                call.cancelled.set()

    def answer(self, request, method, params):
        if method == "initialize":
            asked = params.get("protocolVersion")
            self.send({"id": request, "result": {
                "protocolVersion": asked if asked in PROTOCOLS else PROTOCOLS[0],
                "capabilities": {"tools": {}}, "serverInfo": {"name": NAME, "version": VERSION},
                "instructions": "Makes, rigs, animates and evaluates 3D assets by the studio at " + self.studio.shown}})
        elif method == "ping":
            self.send({"id": request, "result": {}})
        elif method == "tools/list":
            self.send({"id": request, "result": {"tools": [
                {"name": name, "description": description,
                 "inputSchema": {"type": "object", "properties": properties, "required": required,
                                 "additionalProperties": False}}
                for name, (_, description, properties, required) in TOOLS.items()]}})
        elif method == "tools/call":
            tool = params.get("name")
            if not isinstance(tool, str) or tool not in TOOLS:
                raise RpcError(INVALID_PARAMS, f"there is no tool {tool!r}: {', '.join(TOOLS)}")
            arguments = params.get("arguments") or {}
            check_arguments(tool, arguments)
            meta = params.get("_meta")
            call = Call(self, self.studio, meta.get("progressToken") if isinstance(meta, dict) else None)
            with self.lock:
                self.calls[json.dumps(request)] = call
            threading.Thread(target=self.work, args=(request, tool, call, arguments), daemon=True).start()
        else:
            raise RpcError(NO_SUCH_METHOD, f"{method}: there is no such method")

    def work(self, request, tool, call, arguments):
        try:
            result = TOOLS[tool][0](call, arguments)
            self.send({"id": request, "result": {"content": [{"type": "text", "text": json.dumps(result, indent=1)}],
                                                 "structuredContent": result, "isError": False}})
        except ToolError as error:
            self.send({"id": request, "result": {"content": [{"type": "text", "text": str(error)}], "isError": True}})
        except Cancelled:
            pass  # nobody waits for an answer
        except Exception as error:  # of ours: the client must not wait for ever
            self.fail(request, INTERNAL_ERROR, f"{type(error).__name__}: {error}")
        finally:
            with self.lock:
                self.calls.pop(json.dumps(request), None)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--address", default=os.environ.get("ANIGEN_STUDIO", ""),
                        help="address that anigen-studio prints [$ANIGEN_STUDIO]")
    address = parser.parse_args().address
    if not address:
        parser.error("name the address of a running anigen-studio by --address or ANIGEN_STUDIO")
    try:
        studio = Studio(address, os.environ.get("ANIGEN_TOKEN", ""))
    except ValueError as error:
        parser.error(str(error))
    server = Server(studio, sys.stdout.buffer)
    try:
        for line in sys.stdin.buffer:
            if line.strip():
                server.take(line)
    except (KeyboardInterrupt, BrokenPipeError):
        pass
    return 0


if __name__ == "__main__":
    sys.exit(main())
