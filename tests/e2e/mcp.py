#!/usr/bin/env python3
"""The tools of the Model Context Protocol, as a client calls them, of a studio that was started for them.

    mcp.py ANIGEN_STUDIO ANIGEN_MCP [IMAGE]

With IMAGE, in a build with weights, an image becomes an asset, too."""
import json
import os
import pathlib
import queue
import subprocess
import sys
import tempfile
import threading

from studio_client import tube

STUDIO, WRAPPER = sys.argv[1:3]
IMAGE = sys.argv[3] if len(sys.argv) > 3 else ""


class Client:
    """The side of the protocol that has a wrapper as its child."""

    def __init__(self, address):
        self.child = subprocess.Popen([sys.executable, WRAPPER, "--address", address], stdin=subprocess.PIPE,
                                      stdout=subprocess.PIPE)
        self.number, self.answers, self.told = 0, queue.Queue(), []
        threading.Thread(target=self.read, daemon=True).start()

    def read(self):
        for line in self.child.stdout:
            message = json.loads(line)
            assert message["jsonrpc"] == "2.0", message
            if "method" in message:
                self.told.append(message)
            else:
                self.answers.put(message)

    def send(self, line):
        self.child.stdin.write((line if isinstance(line, str) else json.dumps(line)).encode() + b"\n")
        self.child.stdin.flush()

    def begin(self, method, params=None):
        self.number += 1
        message = {"jsonrpc": "2.0", "id": self.number, "method": method}
        self.send(message if params is None else dict(message, params=params))
        return self.number

    def ask(self, method, params=None):
        number = self.begin(method, params)
        answer = self.answers.get(timeout=240)
        assert answer["id"] == number, answer
        return answer

    def call(self, tool, **arguments):
        return self.ask("tools/call", {"name": tool, "arguments": arguments, "_meta": {"progressToken": tool}})["result"]

    def made(self, tool, **arguments):
        result = self.call(tool, **arguments)
        assert not result["isError"], result
        assert json.loads(result["content"][0]["text"]) == result["structuredContent"]
        return result["structuredContent"]

    def refused(self, tool, wanted, **arguments):
        result = self.call(tool, **arguments)
        assert result["isError"] and wanted in result["content"][0]["text"], result

    def error(self, code, method, params=None):
        answer = self.ask(method, params)
        assert answer["error"]["code"] == code, answer


def check_protocol(client):
    hello = client.ask("initialize", {"protocolVersion": "2025-06-18", "capabilities": {},
                                      "clientInfo": {"name": "test", "version": "1"}})["result"]
    assert hello["protocolVersion"] == "2025-06-18" and "tools" in hello["capabilities"], hello
    assert hello["serverInfo"]["name"] == "anigen"
    client.send({"jsonrpc": "2.0", "method": "notifications/initialized"})
    newest = client.ask("initialize", {"protocolVersion": "1999-01-01"})["result"]["protocolVersion"]
    assert newest > "2025", newest
    assert client.ask("ping")["result"] == {}
    tools = {tool["name"]: tool for tool in client.ask("tools/list")["result"]["tools"]}
    assert set(tools) == {"generate", "rig", "animate", "evaluate", "lint", "job_status", "cancel"}, tools.keys()
    for tool in tools.values():
        schema = tool["inputSchema"]
        assert tool["description"] and schema["type"] == "object" and set(schema["required"]) <= set(schema["properties"])
    client.error(-32601, "resources/list")
    client.error(-32602, "tools/call", {"name": "sing"})
    client.error(-32602, "tools/call", {"name": "rig", "arguments": {}})
    client.error(-32602, "tools/call", {"name": "rig", "arguments": {"mesh": "a.obj", "joints": "many"}})
    client.error(-32602, "tools/call", {"name": "rig", "arguments": {"mesh": "a.obj", "colour": "red"}})
    client.error(-32602, "tools/call", {"name": "rig", "arguments": [1]})
    for line, code in (("{", -32700), ("[]", -32600), ("[" * 100_000, -32700), ('{"jsonrpc": "2.0", "id": 1}', -32600),
                       ('{"jsonrpc": "1.0", "id": 1, "method": "ping"}', -32600)):
        client.send(line)
        answer = client.answers.get(timeout=60)
        assert answer["error"]["code"] == code, answer
    client.send({"jsonrpc": "2.0", "method": "notifications/of/another/kind"})
    client.send({"jsonrpc": "2.0", "id": 7, "result": {}})  # an answer to nothing
    assert client.ask("ping")["result"] == {}


def check_tools(client, folder):
    mesh, rigged = folder / "rod.obj", folder / "rigged.glb"
    mesh.write_bytes(tube(10, 8, 1))
    made = client.made("rig", mesh=str(mesh), method="curve", joints=5, motions=["idle"], output=str(rigged))
    assert made["state"] == "done" and made["result"]["joints"] == 5 and made["output"] == str(rigged), made
    assert rigged.read_bytes()[:4] == b"glTF"
    told = [one["params"] for one in client.told if one["params"]["progressToken"] == "rig"]
    numbers = [one["progress"] for one in told]
    assert numbers == sorted(set(numbers)) and all(one["message"] for one in told), told
    packed = client.made("job_status", job=made["id"], output=str(folder / "rod.zip"))["output"]
    assert pathlib.Path(packed).read_bytes()[:2] == b"PK"
    client.refused("job_status", "HTTP 409", job=made["id"], output=str(folder / "rod.vrm"))  # no human
    client.refused("rig", "is there already", mesh=str(mesh), output=str(rigged))
    client.refused("rig", "results end in", mesh=str(mesh), output=str(folder / "a.txt"))
    client.refused("rig", "no such folder", mesh=str(mesh), output=str(folder / "none/a.glb"))
    client.refused("rig", "cannot be read", mesh=str(folder / "missing.obj"))
    client.refused("rig", "magic", mesh=str(mesh), method="magic")
    (folder / "cut.glb").write_bytes(b"glTF")
    client.refused("rig", "failed", mesh=str(folder / "cut.glb"))

    fbx = client.made("animate", job=made["id"], motions=["idle"], output=str(folder / "moved.fbx"))
    assert fbx["kind"] == "animation" and (folder / "moved.fbx").stat().st_size > 1000, fbx
    again = client.made("animate", asset=str(rigged), motions=[], output=str(rigged), overwrite=True)
    assert again["result"]["clips"] == ["idle"] or again["result"]["clips"] == 1, again
    client.refused("animate", "either a job or asset", asset=str(rigged), job=made["id"])
    client.refused("animate", "no ID of a job", job="../../etc")

    scores = client.made("evaluate", job=made["id"], truth=str(rigged), groups=["skeleton"], registration=False)["scores"]
    assert scores["values"]["j2j"] < 1e-5, scores
    client.refused("evaluate", "beauty", prediction=str(rigged), truth=str(rigged), groups=["beauty"])
    found = client.made("lint", asset=str(rigged))
    assert isinstance(found["findings"], list), found
    client.refused("job_status", "404", job=found["job"])  # it was the check's own
    assert client.made("lint", job=made["id"])["findings"] == found["findings"]

    # Without waiting; then cancelled by the tool, or by the client's notification.
    begun = [client.made("rig", mesh=str(mesh), wait=False) for _ in range(4)]
    assert all(job["state"] in ("queued", "running") for job in begun), begun
    client.made("cancel", job=begun[3]["id"])
    client.refused("job_status", "cancelled", job=begun[3]["id"], wait=True)
    client.refused("cancel", "already", job=begun[3]["id"])
    assert client.made("job_status", job=begun[0]["id"], wait=True, output=str(folder / "b.glb"))["state"] == "done"
    # A client that gives up waiting for a job leaves it alone: others may wait for it, too.
    call = client.begin("tools/call", {"name": "job_status", "arguments": {"job": begun[2]["id"], "wait": True}})
    client.send({"jsonrpc": "2.0", "method": "notifications/cancelled", "params": {"requestId": call}})
    assert client.made("job_status", job=begun[2]["id"], wait=True)["state"] == "done"
    call = client.begin("tools/call", {"name": "rig", "arguments": {"mesh": str(mesh)}})
    client.send({"jsonrpc": "2.0", "method": "notifications/cancelled", "params": {"requestId": call}})
    assert client.ask("ping")["result"] == {}, "a cancelled call gets no answer"


def check_generation(client, folder):
    made = client.made("generate", image=IMAGE, motions=["walk"], output=str(folder / "made.glb"))
    assert made["result"]["joints"] > 3 and (folder / "made.glb").read_bytes()[:4] == b"glTF", made
    first = client.made("generate", image=IMAGE, stop_at="voxels", seed=7)
    assert "voxels" in first["pictures"] and "joints" not in first.get("result", {}), first
    client.refused("job_status", "HTTP 4", job=first["id"], output=str(folder / "c.glb"))
    on = client.made("generate", voxels_of=first["id"], seed=7, motions=[], output=str(folder / "on.glb"))
    assert on["result"]["joints"] > 1 and (folder / "on.glb").exists(), on
    client.refused("generate", "name an image")
    client.refused("generate", "no asset to write", image=IMAGE, stop_at="voxels", output=str(folder / "c.glb"))


with tempfile.TemporaryDirectory() as name:
    folder = pathlib.Path(name)
    studio = subprocess.Popen([STUDIO, "--output", name + "/studio", "--quiet"], stdout=subprocess.PIPE, text=True)
    try:
        client = Client(studio.stdout.readline().strip())
        check_protocol(client)
        check_tools(client, folder)
        if IMAGE and os.path.exists(IMAGE):
            check_generation(client, folder)
        studio.terminate()
        studio.wait(60)
        client.refused("rig", "no studio answers", mesh=str(folder / "rod.obj"))
        client.child.stdin.close()
        assert client.child.wait(30) == 0
    finally:
        studio.kill()
bad = subprocess.run([sys.executable, WRAPPER], env={"PATH": os.environ["PATH"]}, stdin=subprocess.DEVNULL,
                     stderr=subprocess.PIPE, text=True)
assert bad.returncode == 2 and "--address" in bad.stderr, bad
print("the tools work")
