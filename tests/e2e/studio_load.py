#!/usr/bin/env python3
"""Many clients of one studio, some of them hostile, processes of jobs that are killed, and a server that is killed in
the middle: every job that was accepted ends with a result or a clear error.

    studio_load.py ANIGEN_STUDIO [JOBS] [CLIENTS]      by itself 24 jobs of 4 clients; 200 8 is the full size

Rigs are of a rod of its own size each; animations and evaluations are of a rig that was made before. Some requests are
hostile: cut files, a zip bomb, 2 GiB announced, paths in names, uploads cut off, options that are no JSON. Some jobs of
a large mesh are ended half-way, by DELETE and by SIGKILL to their process. The server gets SIGKILL when half of the
jobs are accepted, and is started again on the same folder; clients send again what was not accepted. Prints latencies by
kind, peak memory and what became of all jobs."""
import http.client
import io
import json
import os
import pathlib
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import zipfile

sys.dont_write_bytecode = True  # the checkout stays as it is
from studio_client import StudioClient, children, tube

PROGRAM = sys.argv[1]
JOBS = int(sys.argv[2]) if len(sys.argv) > 2 else 24
CLIENTS = int(sys.argv[3]) if len(sys.argv) > 3 else 4
FULL = JOBS >= 200
HOSTILE_EVERY, ENDED_EVERY = (20, 20) if FULL else (4, 12)  # requests; those that are ended half-way half as far in
MOST_SERVER_MEGABYTES, MOST_MEGABYTES = 400, 4000
DEADLINE = 800 if FULL else 200


def bomb():
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        with archive.open("3D/3dmodel.model", "w", force_zip64=True) as part:
            for _ in range(300):
                part.write(b" " * (1 << 20))
    return packed.getvalue()


BOMB = bomb()


LARGE = tube(240, 100, 1.0)
BVH = (b"HIERARCHY\nROOT base\n{\nOFFSET 0 0 0\nCHANNELS 3 Zrotation Xrotation Yrotation\nJOINT a\n{\nOFFSET 0 1 0\n"
       b"CHANNELS 3 Zrotation Xrotation Yrotation\nEnd Site\n{\nOFFSET 0 1 0\n}\n}\n}\nMOTION\nFrames: 2\nFrame Time: 0.5\n"
       b"0 0 0 0 0 0\n0 0 0 30 0 0\n")


class Studio(StudioClient):
    def __init__(self, folder):
        self.folder, self.port, self.peak, self.peak_of_all = folder, 0, 0, 0
        self.start()

    def start(self):
        words = [PROGRAM, "--output", self.folder, "--quiet"] + (["--port", str(self.port)] if self.port else [])
        self.process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
        address = self.process.stdout.readline()
        assert address.startswith("http://127.0.0.1:"), address
        self.port = int(address.strip().rstrip("/").rsplit(":", 1)[1])

    def workers(self):
        """Processes of jobs, the latest last."""
        return children(self.process.pid)

    def measure(self):
        def kilobytes(pid, key):
            try:
                status = pathlib.Path(f"/proc/{pid}/status").read_text()
                return next(int(line.split()[1]) for line in status.split("\n") if line.startswith(key))
            except (OSError, StopIteration):
                return 0
        self.peak = max(self.peak, kilobytes(self.process.pid, "VmHWM") / 1024)
        everyone = [self.process.pid] + self.workers()
        self.peak_of_all = max(self.peak_of_all, sum(kilobytes(pid, "VmRSS") for pid in everyone) / 1024)

    def rig(self, name, content, options=b"{}"):
        return self.send("rig", [("file", name, content), ("options", None, options)])

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

    def job(self, id):
        """The job, {} when there is none; waits while the server is down."""
        while True:
            try:
                status, body = self.ask("GET", "/v1/jobs/" + id)
                return json.loads(body) if status == 200 else {}
            except (OSError, http.client.HTTPException):
                time.sleep(0.1)

    def ended(self, id):
        while (job := self.job(id)).get("state") in ("queued", "running"):
            time.sleep(0.05)
        return job


HEAD = b"POST /v1/3d/rigs HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: multipart/form-data; boundary=b\r\n"
ROD = b'{"method": "pinocchio", "templates": ["snake"], "motions": []}'
accepted, answers, refusals, problems, killed, lock = {}, {}, [], [], [], threading.Lock()


def hostile(studio, number):
    """One hostile request, and the state in which a job of it may end; None: it must be refused."""
    kind = number // HOSTILE_EVERY % 9
    if kind == 0:
        return studio.rig("bomb.3mf", BOMB), "failed"
    if kind == 1:
        answer = studio.raw(HEAD + b"Content-Length: 2147483648\r\n\r\n")
        return (int(answer[9:12]), answer), None
    if kind == 2:
        return studio.rig("../../../etc/passwd", b"root"), None
    if kind == 3:
        studio.raw(HEAD + b"Content-Length: 90000\r\n\r\n--b\r\nContent-Disposition: form-data; name=\"file\"; filename=\"a.obj\"\r\n\r\nv 0", cut=True)
        return (400, b'{"error": "nobody is there to hear it"}'), None
    if kind == 4:
        return studio.rig("cut.glb", b"glTF\x02\0\0\0\xff\xff\xff\x7f"), "failed"
    if kind == 5:
        return studio.rig("a.obj", tube(4, 4, 1), b'{"method": '), None
    if kind == 6:
        return studio.ask("GET", "/v1/jobs/..%2f..%2fjobs%2fj000001%2fjob.json"), None
    if kind == 7:  # 4 GiB in its header, and none behind it
        return studio.rig("huge.ply", b"ply\nformat binary_little_endian 1.0\nelement vertex 357913941\nproperty float x\nproperty float y\nproperty float z\nend_header\n"), "failed"
    return studio.send("evaluation", [("job", None, b"../j000001"), ("truth", "a.glb", RIGGED)]), None


def request(studio, number):
    """Kind, answer and expected states of one request."""
    if number % HOSTILE_EVERY == HOSTILE_EVERY - 1:
        answer, state = hostile(studio, number)
        return "hostile", answer, {state}
    if number % ENDED_EVERY == ENDED_EVERY // 2 - 1:
        return "large rig", studio.rig(f"large{number}.obj", LARGE), {"done", "failed", "cancelled"}
    if number % 5 == 1:
        parts = [("file", f"rod{number}.glb", RIGGED), ("motion", "nod.bvh", BVH), ("options", None, b'{"motions": []}')]
        return "animation", studio.send("animation", parts), {"done"}
    if number % 5 == 3:
        return "evaluation", studio.send("evaluation", [("file", "a.glb", RIGGED), ("truth", "b.glb", RIGGED)]), {"done"}
    return "rig", studio.rig(f"rod{number}.obj", tube(10, 8, 1 + number / 100), ROD), {"done"}


def end_half_way(studio, id, by_signal):
    """Ends a job that is at work, by DELETE or by a signal to its process."""
    while (job := studio.job(id)).get("state") == "queued" or (job.get("state") == "running" and job["stage"] in ("", "reading")):
        time.sleep(0.02)
    if job.get("state") != "running":
        return
    try:
        if by_signal:
            os.kill(studio.workers()[-1], signal.SIGKILL)
            with lock:
                killed.append(id)
        else:
            studio.ask("DELETE", "/v1/jobs/" + id)
    except (OSError, IndexError, http.client.HTTPException):
        pass  # the server was killed first


def send(studio, number):
    while True:
        began = time.monotonic()
        try:
            kind, (status, body), expected = request(studio, number)
        except (OSError, http.client.HTTPException):
            time.sleep(0.1)  # the server is down
            continue
        if status != 429:
            break
        time.sleep(0.2)
    with lock:
        answers.setdefault(kind, []).append(time.monotonic() - began)
        if status == 201:
            accepted[json.loads(body)["id"]] = (kind, expected)
            if None in expected:
                problems.append(f"request {number} is hostile and was accepted")
        else:
            refusals.append(status)
            if kind != "hostile" or not 400 <= status < 500 or b'"error"' not in body:
                problems.append(f"request {number}: {status} {body[:200]}")
    if kind == "large rig" and status == 201:
        end_half_way(studio, json.loads(body)["id"], number // ENDED_EVERY % 2 == 0)


def client(studio, numbers):
    for number in numbers:
        send(studio, number)


def judge(jobs):
    """Problems of jobs that ended otherwise than they may. @return how many ended in each state"""
    states, by_signal = {}, 0
    for id, (kind, expected) in accepted.items():
        job = jobs.get(id, {"state": "lost", "error": ""})
        state, error = job["state"], job["error"]
        states[state] = states.get(state, 0) + 1
        by_signal += "signal 9" in error
        if state not in expected and "signal 9" not in error:
            problems.append(f"{id} ({kind}) is {state}, not {expected}: {error}")
        if state == "failed" and not error:
            problems.append(f"{id} failed without a reason")
    if by_signal > len(killed):
        problems.append(f"{by_signal} jobs say that their process was killed, and {len(killed)} were")
    return states, by_signal


def row(name, values, unit):
    values = sorted(values)
    at = [values[min(len(values) - 1, int(q * len(values)))] * unit for q in (0.5, 0.95, 1)]
    return f"{name:22} {len(values):5} {at[0]:9.0f} {at[1]:9.0f} {at[2]:9.0f}"


def main():
    global RIGGED
    with tempfile.TemporaryDirectory(prefix="anigen-studio-") as folder:
        studio = Studio(folder)
        first = studio.ended(json.loads(studio.rig("rod.obj", tube(10, 8, 1), ROD)[1])["id"])
        for job in json.loads(studio.ask("GET", "/v1/jobs")[1])["jobs"]:
            if not FULL and job["kind"] == "generation":  # the image of the first start
                studio.ask("DELETE", "/v1/jobs/" + job["id"])
        RIGGED = studio.ask("GET", f"/v1/jobs/{first['id']}/files/rigged.glb")[1]
        began = time.monotonic()
        threads = [threading.Thread(target=client, args=(studio, range(c, JOBS, CLIENTS))) for c in range(CLIENTS)]
        for thread in threads:
            thread.start()
        restarted = False
        while any(thread.is_alive() for thread in threads):
            studio.measure()
            if not restarted and len(accepted) >= JOBS // 2:
                restarted = True
                studio.process.send_signal(signal.SIGKILL)
                studio.process.wait()
                studio.start()
            time.sleep(0.02)
        while True:
            studio.measure()
            jobs = json.loads(studio.ask("GET", "/v1/jobs")[1])["jobs"]
            if all(job["state"] not in ("queued", "running") for job in jobs) or time.monotonic() - began > DEADLINE:
                break
            time.sleep(0.1)
        seconds = time.monotonic() - began
        jobs = {job["id"]: job for job in jobs}
        states, by_signal = judge(jobs)
        left = [str(file) for file in pathlib.Path(folder).glob("jobs/*/*tmp-*")]
        left += [str(file) for file in pathlib.Path(folder).glob("jobs/*/scratch")]
        if left:
            problems.append(f"files were left behind: {left[:3]}")
        studio.process.send_signal(signal.SIGINT)
        if studio.process.wait(timeout=30) != 0:
            problems.append("Ctrl-C gives an exit status")
    print(f"{JOBS} requests of {CLIENTS} clients, server killed once{'' if restarted else ' (not)'}: {len(accepted)} accepted "
          f"{states}, {by_signal} by a killed process, {len(refusals)} refused, {seconds:.1f} s")
    print(f"{'milliseconds':22} {'count':>5} {'median':>9} {'95 %':>9} {'slowest':>9}")
    for kind, values in sorted(answers.items()):
        print(row("answer, " + kind, values, 1000))
    for kind in ("generation", "rig", "animation", "evaluation"):
        done = [job for job in jobs.values() if job["kind"] == kind and job["state"] == "done"]
        if done:
            print(row(f"waiting, {kind}", [job["started"] - job["created"] for job in done], 1000))
            print(row(f"work, {kind}", [job["ended"] - job["started"] for job in done], 1000))
    print(f"peak memory: server {studio.peak:.0f} MB, with processes of jobs {studio.peak_of_all:.0f} MB")
    if studio.peak > MOST_SERVER_MEGABYTES or studio.peak_of_all > MOST_MEGABYTES:
        problems.append("that is too much memory")
    if not restarted:
        problems.append("the server was not killed")
    for problem in problems:
        print("FAILED:", problem)
    return 1 if problems else 0


RIGGED = b""
sys.exit(main())
