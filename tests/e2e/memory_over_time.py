#!/usr/bin/env python3
"""Memory of long runs: a training of many steps, a studio of many jobs. It must not grow with their number.

    memory_over_time.py BIN SOURCE [--steps N] [--jobs N] [--output FOLDER]     0 leaves one of them out

BIN has the programs, SOURCE is the checkout. The training is configs/tiny/skin_ae.json on three creatures, with samples,
evaluations and checkpoints on the way; the studio rigs, animates, evaluates, binds edited joints again and gives its
files to a client. Memory is what /proc calls VmRSS, of the studio also with the processes of its jobs. The last fifth of
a run may have MOST_GROWTH more of it than the second fifth, in the middle. --output: curves as CSV and SVG."""
import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

sys.dont_write_bytecode = True  # the checkout stays as it is
from studio_client import StudioClient, children, tube

MOST_GROWTH = 16.0  # MB: of a job that is kept, the studio knows some kB
PIECES = 5


def resident(pid):
    """MB; 0 when the process is gone."""
    try:
        for line in pathlib.Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith("VmRSS:"):
                return int(line.split()[1]) / 1024
    except OSError:
        pass
    return 0.0


class Curve:
    """Memory against the number of steps or jobs."""

    def __init__(self, name, unit, columns):
        self.name, self.unit, self.columns, self.points = name, unit, columns, []

    def add(self, count, *values):
        self.points.append((count, *values))

    def growth(self, column=1):
        """MB by which the last fifth exceeds the second, by their medians."""
        last = self.points[-1][0]

        def middle(piece):
            values = sorted(point[column] for point in self.points if piece <= PIECES * point[0] / (last + 1) < piece + 1)
            return values[len(values) // 2]
        return middle(PIECES - 1) - middle(1)

    def csv(self):
        return "\n".join([",".join([self.unit, *self.columns])] + [",".join(f"{value:g}" for value in point) for point in self.points]) + "\n"

    def svg(self):
        width, height, left, top = 640, 240, 56, 16
        most = 1.1 * max(max(point[1:]) for point in self.points)
        last = max(1, self.points[-1][0])
        lines = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width + left + 16} {height + 56}" font-family="sans-serif" font-size="12">',
                 f'<path d="M{left},{top} v{height} h{width}" fill="none" stroke="#888"/>',
                 f'<text x="{left - 4}" y="{top + 10}" text-anchor="end">{most:.0f}</text>',
                 f'<text x="{left - 4}" y="{top + height}" text-anchor="end">0 MB</text>',
                 f'<text x="{left + width}" y="{top + height + 16}" text-anchor="end">{last} {self.unit}s</text>']
        for number, column in enumerate(self.columns):
            color = ("#1f77b4", "#ff7f0e")[number % 2]
            path = " ".join(f"{left + width * point[0] / last:.1f},{top + height * (1 - point[1 + number] / most):.1f}" for point in self.points)
            lines.append(f'<polyline points="{path}" fill="none" stroke="{color}"/>')
            lines.append(f'<text x="{left + 8 + 180 * number}" y="{top + height + 16}" fill="{color}">{column}</text>')
        return "\n".join(lines) + "\n</svg>\n"


def steps_logged(folder):
    """Number of the last step in a run's metrics.csv."""
    try:
        with open(folder / "metrics.csv", "rb") as file:
            file.seek(max(0, file.seek(0, os.SEEK_END) - 4096))
            return int(file.read().splitlines()[-1].split(b",")[0])
    except (OSError, ValueError, IndexError):
        return 0


def training(bin, source, folder, steps):
    data, run = folder / "data", folder / "run"
    subprocess.run([bin / "anigen-prepare", "--quiet", "--procedural", "3", "--procedural-test", "1", "--views", "1", "--view-size",
                    "32", "--cond-views", "1", "--cond-view-size", "24", "--workers", "1", "--output", data], check=True)
    words = [bin / "anigen-train", "--quiet", "--config", source / "configs/tiny/skin_ae.json", "--dataset", data, "--output", run]
    settings = {"max_steps": steps, "i_save": max(1, steps // 10), "i_sample": max(1, steps // 10), "i_eval": max(1, steps // 10), "i_log": 10}
    for key, value in settings.items():
        words += ["--set", f"trainer.args.{key}={value}"]
    curve = Curve("training", "step", ["anigen-train"])
    process = subprocess.Popen(words)
    while process.poll() is None:
        step, memory = steps_logged(run), resident(process.pid)
        if memory > 0 and (not curve.points or step > curve.points[-1][0]):
            curve.add(step, memory)
        time.sleep(0.25)
    assert process.returncode == 0, f"anigen-train ended with status {process.returncode}"
    return curve


class Studio(StudioClient):
    def __init__(self, program, folder):
        words = [program, "--output", folder, "--quiet"]
        self.process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
        self.port = int(self.process.stdout.readline().strip().rstrip("/").rsplit(":", 1)[1])

    def post(self, kind, parts):
        """The job, once it has ended well."""
        status, body = self.send(kind, parts)
        assert status == 201, body
        job = json.loads(body)
        while job["state"] in ("queued", "running"):
            time.sleep(0.01)
            job = json.loads(self.ask("GET", "/v1/jobs/" + job["id"])[1])
        assert job["state"] == "done", job
        return job

    def rebind(self, id):
        """The joints as they are, bound again."""
        rig = {"joints": [{"name": "a", "parent": -1, "position": [0, 0, 0]}, {"name": "b", "parent": 0, "position": [0.5, 0, 0]}],
               "method": "heat"}
        status, body = self.ask("POST", f"/v1/jobs/{id}/rebind", json.dumps(rig), {"Content-Type": "application/json"})
        assert status == 200, body[:300]


def studio(bin, folder, jobs):
    curve = Curve("studio", "job", ["anigen-studio", "with processes of jobs"])
    studio = Studio(bin / "anigen-studio", folder / "studio")
    peak = 0.0
    try:
        for job in json.loads(studio.ask("GET", "/v1/jobs")[1])["jobs"]:
            if job["kind"] == "generation":  # the image of the first start
                studio.ask("DELETE", "/v1/jobs/" + job["id"])
        options = b'{"method": "pinocchio", "templates": ["snake"], "motions": []}'
        rigged, rig = b"", {}
        for number in range(jobs):
            kind = ("rig", "animation", "evaluation", "rig")[number % 4] if rigged else "rig"
            if kind == "rig":
                rig = studio.post("rig", [("file", "rod.obj", tube(10, 8, 1 + number % 100 / 100)), ("options", None, options)])
                rigged = studio.ask("GET", f"/v1/jobs/{rig['id']}/files/rigged.glb")[1]
                studio.rebind(rig["id"])
            elif kind == "animation":
                studio.post("animation", [("file", "rod.glb", rigged), ("options", None, b'{"motions": ["idle"]}')])
            else:
                studio.post("evaluation", [("file", "a.glb", rigged), ("truth", "b.glb", rigged)])
            everyone = resident(studio.process.pid) + sum(resident(pid) for pid in children(studio.process.pid))
            peak = max(peak, everyone)
            if number % max(1, jobs // 200) == 0:
                curve.add(number, resident(studio.process.pid), peak)
                peak = 0.0
    finally:
        studio.process.terminate()
        status = studio.process.wait(60)
    assert status == 0, f"anigen-studio ended with status {status}"
    return curve


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("bin", type=lambda text: pathlib.Path(text).resolve())
    parser.add_argument("source", type=lambda text: pathlib.Path(text).resolve())
    parser.add_argument("--steps", type=int, default=10000)
    parser.add_argument("--jobs", type=int, default=1000)
    parser.add_argument("--output", type=pathlib.Path)
    arguments = parser.parse_args()
    problems = []
    with tempfile.TemporaryDirectory(prefix="anigen-memory-") as place:
        folder = pathlib.Path(place)
        for count, make in ((arguments.steps, lambda: training(arguments.bin, arguments.source, folder, arguments.steps)),
                            (arguments.jobs, lambda: studio(arguments.bin, folder, arguments.jobs))):
            if count == 0:
                continue
            began = time.monotonic()
            curve = make()
            if arguments.output:
                arguments.output.mkdir(parents=True, exist_ok=True)
                (arguments.output / f"{curve.name}.csv").write_text(curve.csv())
                (arguments.output / f"{curve.name}.svg").write_text(curve.svg())
            for number, column in enumerate(curve.columns):
                growth = curve.growth(1 + number)
                print(f"{curve.name}, {count} {curve.unit}s, {column}: {curve.points[-1][1 + number]:.0f} MB at the end, "
                      f"{growth:+.1f} MB from the second fifth to the last, {time.monotonic() - began:.0f} s", flush=True)
                if growth > MOST_GROWTH:
                    problems.append(f"{column} grows")
    for problem in problems:
        print("FAILED:", problem)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
