#!/usr/bin/env python3
"""Many clients of one studio, some of them hostile, and a server that is killed in the middle: every job that was
accepted ends with a result or a clear error.

    studio_load.py ANIGEN_STUDIO [JOBS] [CLIENTS]

Meshes go through the mesh door: a rod of its own size each. Every tenth request is hostile: a cut file, a zip bomb as
.3mf, 2 GiB announced, a path in the name, an upload cut off, options that are no JSON. The server gets SIGKILL when half
of the jobs are accepted, and is started again on the same folder; clients send again what was not accepted. Prints
latencies, peak memory and what became of all jobs."""
import http.client
import io
import json
import math
import pathlib
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import zipfile

PROGRAM = sys.argv[1]
JOBS = int(sys.argv[2]) if len(sys.argv) > 2 else 40
CLIENTS = int(sys.argv[3]) if len(sys.argv) > 3 else 4
MOST_MEGABYTES = 1500


def rod(number):
    rings, sides, lines = 10, 8, []
    for r in range(rings):
        for s in range(sides):
            a = 2 * math.pi * s / sides
            lines.append(f"v {r / rings * (1 + number / 100)} {0.08 * math.cos(a)} {0.08 * math.sin(a)}")
    for r in range(rings - 1):
        for s in range(sides):
            a, b = r * sides + s + 1, r * sides + (s + 1) % sides + 1
            lines.append(f"f {a} {b} {b + sides} {a + sides}")
    lines.append("f " + " ".join(str(s + 1) for s in reversed(range(sides))))
    lines.append("f " + " ".join(str((rings - 1) * sides + s + 1) for s in range(sides)))
    return ("\n".join(lines) + "\n").encode()


def bomb():
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        with archive.open("3D/3dmodel.model", "w", force_zip64=True) as part:
            for _ in range(300):
                part.write(b" " * (1 << 20))
    return packed.getvalue()


BOMB = bomb()


class Studio:
    def __init__(self, folder):
        self.folder, self.port, self.peak = folder, 0, 0
        self.start()

    def start(self):
        words = [PROGRAM, "--output", self.folder, "--quiet"] + (["--port", str(self.port)] if self.port else [])
        self.process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
        address = self.process.stdout.readline()
        assert address.startswith("http://127.0.0.1:"), address
        self.port = int(address.strip().rstrip("/").rsplit(":", 1)[1])

    def measure(self):
        try:
            status = pathlib.Path(f"/proc/{self.process.pid}/status").read_text()
            self.peak = max(self.peak, next(int(l.split()[1]) for l in status.split("\n") if l.startswith("VmHWM")) / 1024)
        except (OSError, StopIteration):
            pass

    def ask(self, method, path, body=None, headers=None):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        try:
            connection.request(method, path, body, headers or {})
            answer = connection.getresponse()
            return answer.status, answer.read()
        finally:
            connection.close()

    def upload(self, name, content, options=None):
        body = (f'--b\r\nContent-Disposition: form-data; name="file"; filename="{name}"\r\n\r\n').encode() + content
        if options is not None:
            body += f'\r\n--b\r\nContent-Disposition: form-data; name="options"\r\n\r\n{options}'.encode()
        return self.ask("POST", "/api/jobs", body + b"\r\n--b--\r\n", {"Content-Type": "multipart/form-data; boundary=b"})

    def raw(self, request, cut=False):
        with socket.create_connection(("127.0.0.1", self.port), timeout=60) as connection:
            connection.sendall(request)
            connection.shutdown(socket.SHUT_WR)
            answer = b""
            while piece := connection.recv(4096):
                answer += piece
        if not answer and not cut:
            raise ConnectionError("the server went away")
        return answer


HEAD = b"POST /api/jobs HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: multipart/form-data; boundary=b\r\n"
accepted, latencies, refusals, problems, lock = {}, [], [], [], threading.Lock()


def hostile(studio, number):
    """One hostile request; a job that it may make must fail with a reason."""
    kind = number // 10 % 6
    if kind == 0:
        return studio.upload("cut.glb", b"glTF\x02\0\0\0\xff\xff\xff\x7f"), "failed"
    if kind == 1:
        return studio.upload("bomb.3mf", BOMB), "failed"
    if kind == 2:
        answer = studio.raw(HEAD + b"Content-Length: 2147483648\r\n\r\n")
        return (int(answer[9:12]), answer), None
    if kind == 3:
        return studio.upload("../../../etc/passwd", b"root"), None
    if kind == 4:
        studio.raw(HEAD + b"Content-Length: 90000\r\n\r\n--b\r\nContent-Disposition: form-data; name=\"file\"; filename=\"a.obj\"\r\n\r\nv 0", cut=True)
        return (400, b'{"error": "nobody is there to hear it"}'), None
    return studio.upload("a.obj", rod(number), "{\"method\": "), None


def send(studio, number):
    bad = number % 10 == 9
    expected = None if bad else "done"
    while True:
        began = time.monotonic()
        try:
            if bad:
                (status, body), expected = hostile(studio, number)
            else:
                status, body = studio.upload(f"rod{number}.obj", rod(number), '{"method": "pinocchio", "templates": ["snake"], "motions": []}')
        except (OSError, http.client.HTTPException):
            time.sleep(0.1)  # the server is down
            continue
        if status == 429:
            time.sleep(0.2)
            continue
        break
    with lock:
        latencies.append(time.monotonic() - began)
        if status == 201:
            accepted[json.loads(body)["id"]] = expected
            if expected is None:
                problems.append(f"request {number} is hostile and was accepted")
        else:
            refusals.append(status)
            if not bad or not 400 <= status < 500 or b'"error"' not in body:
                problems.append(f"request {number}: {status} {body[:200]}")


def client(studio, numbers):
    for number in numbers:
        send(studio, number)


def main():
    with tempfile.TemporaryDirectory(prefix="anigen-studio-") as folder:
        studio = Studio(folder)
        began = time.monotonic()
        threads = [threading.Thread(target=client, args=(studio, range(c, JOBS, CLIENTS))) for c in range(CLIENTS)]
        for thread in threads:
            thread.start()
        killed = False
        while any(thread.is_alive() for thread in threads):
            studio.measure()
            if not killed and len(accepted) >= JOBS // 2:
                killed = True
                studio.process.send_signal(signal.SIGKILL)
                studio.process.wait()
                studio.start()
            time.sleep(0.02)
        states = {}
        while True:
            studio.measure()
            jobs = json.loads(studio.ask("GET", "/api/jobs")[1])["jobs"]
            if all(job["state"] in ("done", "failed") for job in jobs) or time.monotonic() - began > 500:
                break
            time.sleep(0.2)
        seconds = time.monotonic() - began
        found = {job["id"]: job for job in jobs}
        for job, expected in accepted.items():
            state = found.get(job, {}).get("state", "lost")
            states[state] = states.get(state, 0) + 1
            if state != expected:
                problems.append(f"{job} is {state}, not {expected}: {found.get(job, {}).get('error')}")
            if state == "failed" and not found[job]["error"]:
                problems.append(f"{job} failed without a reason")
        studio.process.send_signal(signal.SIGINT)
        if studio.process.wait(timeout=30) != 0:
            problems.append("Ctrl-C gives an exit status")
    latencies.sort()
    at = [latencies[min(len(latencies) - 1, int(q * len(latencies)))] * 1000 for q in (0.5, 0.95, 1)]
    print(f"{JOBS} requests of {CLIENTS} clients, killed once{'' if killed else ' (not)'}: {len(accepted)} accepted {states}, "
          f"{len(refusals)} refused, {seconds:.1f} s")
    print(f"answers: median {at[0]:.0f} ms, 95 % {at[1]:.0f} ms, slowest {at[2]:.0f} ms; peak memory {studio.peak:.0f} MB")
    if studio.peak > MOST_MEGABYTES:
        problems.append(f"{studio.peak:.0f} MB")
    if not killed:
        problems.append("the server was not killed")
    for problem in problems:
        print("FAILED:", problem)
    return 1 if problems else 0


sys.exit(main())
