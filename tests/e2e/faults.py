#!/usr/bin/env python3
"""Faults of the machine against whole programs: none of them may cost a file that was finished, leave half of one, or
change what comes out in the end.

    faults.py BIN SOURCE [--quick] [--program NAME]… [--fault NAME]… [--trials N] [--seed N] [--output FOLDER]

BIN has the programs, SOURCE is the checkout. Each piece of work (preparing, training, an experiment, generating, rigging,
a studio) runs once undisturbed; then each trial disturbs it, by a signal at a random moment, a full or read-only disk, an
input that vanishes, times of files in the future, a second program on the same folder, leases of a machine that is gone,
or what a power loss leaves of a run that was recorded (power_loss.py). After the fault every file under a final name must
be whole and what the program said must be clear; the same command must then finish, and give the same bytes as the
undisturbed run. --quick: a trial of each fault, of the work that ends soonest.
Prints a table in Markdown; --output writes it there as table.md, with a line a trial in trials.csv. Disks that fill are
small tmpfs in a mount namespace of our own (root); without one the limit on the size of files (RLIMIT_FSIZE) stands in."""
import argparse
import hashlib
import json
import os
import pathlib
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time

sys.dont_write_bytecode = True  # the checkout stays as it is
from fault_files import TEMPORARY, Results, Wrong, bytes_below, check_files, check_words, in_own_mounts, left_out, require
from power_loss import Recorded
from studio_client import StudioClient

DAY = 86400
LONG_SECONDS = 300

EXPERIMENT = {
    "title": "Two creatures", "purpose": "a test of faults",
    "steps": {"dataset": {"program": "anigen-prepare", "args": {"--procedural": 2, "--procedural-test": 1, "--views": 1,
                                                                   "--view-size": 32, "--cond-views": 1, "--cond-view-size": 24}},
              "rigged": {"program": "anigen-rig", "args": {"--method": "nearest", "--mesh": "{dataset}"}},
              "scores": {"program": "anigen-eval", "args": {"--pred": "nearest={rigged}", "--dataset": "{dataset}",
                                                            "--surface-samples": 100, "--rotations": 1}}},
    "tables": [{"title": "Scores", "step": "scores", "columns": [{"key": "j2j", "better": "lower"}]}]}


# --- Programs --------------------------------------------------------------------------------------------------------


class Command:
    """A command that is given an output folder. `results`: patterns of its files that do not differ between two runs.
    `other`: words with which it replaces what it made without them."""

    def __init__(self, name, words, results, inputs, other=()):
        self.name, self.words, self.results, self.inputs, self.other = name, words, results, inputs, other

    def start(self, out, limit=None):
        def lower():
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
        words = [str(word).replace("{out}", str(out)) for word in self.words]
        return subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                                errors="replace", start_new_session=True, preexec_fn=lower if limit else None)

    def run(self, out, limit=None):
        """(status, what it said)"""
        return finish(self.start(out, limit))

    def contents(self, out):
        found = {}
        for pattern in self.results:
            for file in out.glob(pattern):
                name = str(file.relative_to(out))
                if file.is_file() and TEMPORARY not in name and "/run/" not in "/" + name:
                    found[name] = hashlib.sha256(file.read_bytes()).hexdigest()
        return found


def finish(process, seconds=LONG_SECONDS):
    try:
        said, _ = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        raise Wrong(f"did not end within {seconds} s") from None
    return process.returncode, said


def kill(process):
    """To the program and what it started, as a machine that loses its power."""
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except ProcessLookupError:
        pass
    return finish(process)


# --- One command under a fault ---------------------------------------------------------------------------------------


class Trial:
    def __init__(self, command, whole, seconds, folder, randomness):
        self.command, self.whole, self.seconds, self.random = command, whole, seconds, randomness
        self.out = folder / "out"
        self.out.mkdir(parents=True)
        self.folder, self.said, self.mounted = folder, "", False
        self.kept, self.sizes = {}, {}
        self.lost, self.moment = 0, ""  # bytes that the fault itself cost; when it came

    def mount(self, size):
        self.mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "none", self.out]).returncode == 0
        return self.mounted

    def remount(self, options):
        subprocess.run(["mount", "-o", f"remount,{options}", self.out], check=True)

    def close(self):
        if self.mounted:
            subprocess.run(["umount", "-l", self.out], check=True)
        shutil.rmtree(self.folder, ignore_errors=True)

    def after_fault(self):
        """Nothing is half-written; notes what is finished already."""
        check_files(self.out)
        check_words(self.said)
        self.kept = {name: value for name, value in self.command.contents(self.out).items() if self.whole.get(name) == value}
        self.sizes = {name: (self.out / name).stat().st_size for name in self.kept}

    def failed_clearly(self, status, *words):
        require(status in (1, 2), f"status {status}: {self.said[-300:]}")
        require(any(word in self.said for word in words), f"none of {words} in: {self.said[-300:]}")

    def finishes(self):
        """The same command ends well, with the bytes of the undisturbed run. @return bytes lost"""
        status, said = self.command.run(self.out)
        require(status == 0, f"the same command again: status {status}: {said[-400:]}")
        check_files(self.out)
        found = self.command.contents(self.out)
        lost = sum(self.sizes[name] for name, value in self.kept.items() if found.get(name) != value)
        missing, other = sorted(set(self.whole) - set(found)), sorted(set(found) - set(self.whole))
        differ = sorted(name for name in found if name in self.whole and found[name] != self.whole[name])
        require(not (missing or other or differ), f"missing {missing[:3]}, too much {other[:3]}, different {differ[:3]}")
        return lost

    def killed_half_way(self):
        process = self.command.start(self.out)
        time.sleep(self.random.uniform(0.02, 0.9) * self.seconds)
        check_words(kill(process)[1])
        self.after_fault()


def fault_kill(trial):
    trial.killed_half_way()


def fault_full(trial):
    need = bytes_below(trial.folder.parent / f"{trial.command.name}-whole")
    share = trial.random.uniform(0.0, 0.7)
    size = max(4096, int(need * share) // 4096 * 4096)
    if trial.mount(size):
        status, trial.said = trial.command.run(trial.out)
        trial.failed_clearly(status, "No space left")
        trial.after_fault()
        trial.remount(f"size={64 * need + (64 << 20)}")
    else:
        largest = max(file.stat().st_size for file in (trial.folder.parent / f"{trial.command.name}-whole").rglob("*") if file.is_file())
        status, trial.said = trial.command.run(trial.out, max(1, int(largest * share)))
        trial.failed_clearly(status, "File too large")
        trial.after_fault()


def fault_read_only(trial):
    if not trial.mount(1 << 30):
        trial.out.chmod(0o555)
    else:
        trial.remount("ro")
    status, trial.said = trial.command.run(trial.out)
    trial.failed_clearly(status, "Read-only file system", "Permission denied")
    trial.after_fault()
    require(not list(trial.out.iterdir()), "it wrote something")
    if trial.mounted:
        trial.remount("rw")
    else:
        trial.out.chmod(0o755)


def fault_vanishes(trial):
    """An input goes away at a random moment, from before the start on."""
    target = trial.random.choice(trial.command.inputs)
    hidden = target.with_name(target.name + ".hidden")
    moment = trial.random.uniform(0.0, 0.8) * trial.seconds if trial.random.random() < 0.7 else 0
    try:
        if moment == 0:
            target.rename(hidden)
        process = trial.command.start(trial.out)
        time.sleep(moment)
        if moment:
            target.rename(hidden)
        status, trial.said = finish(process)
    finally:
        if hidden.exists():
            hidden.rename(target)
    require(status in (0, 1, 2), f"status {status}: {trial.said[-300:]}")
    if status == 0:
        trial.said = ""
    else:
        require(target.name.split(".")[0] in trial.said, f"it does not name {target.name}: {trial.said[-300:]}")
    trial.after_fault()


def set_times(folder, ahead):
    for file in folder.rglob("*"):
        if file.is_file():
            os.utime(file, (time.time() + ahead, time.time() + ahead))


def fault_clock(trial):
    """Killed, then the clock jumps: files are of tomorrow, or of last year."""
    trial.killed_half_way()
    set_times(trial.out, trial.random.choice([DAY, -365 * DAY]))


def fault_leases(trial):
    """Killed on a machine that is gone: locks and leases tell of a process that nobody here can ask for."""
    trial.killed_half_way()
    leave_machine(trial.out, {"host": "gone", "space": "another-boot/pid:[1]"})


def leave_machine(folder, changes):
    """Locks and leases get old, and tell of another machine, or of this one before it started anew."""
    for file in folder.rglob("*"):
        try:
            holder = json.loads(file.read_bytes()) if file.is_file() and file.stat().st_size < 4096 else None
        except ValueError:
            continue
        if isinstance(holder, dict) and {"host", "space", "id", "started"} <= set(holder):
            file.write_text(json.dumps({**holder, **changes}))
            os.utime(file, (time.time() - 1000, time.time() - 1000))


def fault_together(trial):
    """Two programs at once: they share the work, or the second is told who has it."""
    first = trial.command.start(trial.out)
    time.sleep(trial.random.uniform(0.0, 0.5) * trial.seconds)
    second = trial.command.start(trial.out)
    status, said = finish(second)
    first_status, first_said = finish(first)
    require(0 in (status, first_status), f"statuses {first_status} and {status}: {first_said[-200:]} {said[-200:]}")
    for one, words in ((status, said), (first_status, first_said)):
        require(one in (0, 1, 2), f"status {one}: {words[-300:]}")
        if one != 0:
            trial.said = words
    trial.after_fault()


REPLACING = "power loss, replacing"
RECORDED = {}  # by program: a run on the recording file system, which trials share


def lose_power(trial, work, kind=""):
    """Goes on with what the disk has after a power loss. @param work what is recorded: returns results and `told`"""
    name = trial.command.name + kind
    if name not in RECORDED:
        RECORDED[name] = Recorded(trial.folder.parent / f"{trial.folder.name}-recorded", work)
    run = RECORDED[name]
    results, told = run.told
    trial.out = run.out
    count, must, trial.moment = run.lose_power(trial.random)
    set_times(trial.out, -1000)  # it was off for a while
    leave_machine(trial.out, {"space": "another-boot/pid:[1]"})
    trial.after_fault()
    found = trial.command.contents(trial.out)
    lost = [name for name in sorted(must) if results.get(name) == hashlib.sha256(must[name]).hexdigest() != found.get(name)]
    trial.lost = sum(len(must[name]) for name in lost)
    trial.moment += f"; lost: {', '.join(lost[:3])}" if lost else ""
    return count, told


def fault_power(trial):
    def work(out, position):
        status, said = trial.command.run(out)
        require(status == 0, f"status {status} on the recording file system: {said[-300:]}")
        results = trial.command.contents(out)
        require(results == trial.whole, "other results on the recording file system")
        return results, None
    lose_power(trial, work)


def fault_power_replacing(trial):
    """What was made is made anew with other settings, meanwhile the power is lost; then the first settings again."""
    command = trial.command
    other = Command(command.name, [*command.words, *command.other], command.results, command.inputs)

    def work(out, position):
        for one in (command, other):
            status, said = one.run(out)
            require(status == 0, f"status {status} on the recording file system: {said[-300:]}")
        results = other.contents(out)
        require(results != trial.whole, "other settings gave the same")
        return results, None
    lose_power(trial, work, ", replacing")


FAULTS = [("SIGKILL", fault_kill, 20), ("disk full", fault_full, 10), ("read-only folder", fault_read_only, 2),
          ("input vanishes", fault_vanishes, 5), ("clock jumps", fault_clock, 5),
          ("two at once", fault_together, 5), ("leases of a lost machine", fault_leases, 5),
          ("power loss", fault_power, 20), (REPLACING, fault_power_replacing, 20)]


# --- The studio ------------------------------------------------------------------------------------------------------


class Studio(StudioClient):
    """A studio in a folder; jobs of one small rig."""
    OPTIONS = b'{"method": "nearest", "motions": []}'
    RIG = b""

    def __init__(self, program, out):
        self.process = subprocess.Popen([program, "--output", out, "--quiet", "--threads", "1"], stdout=subprocess.PIPE,
                                        stderr=subprocess.STDOUT, text=True, start_new_session=True)
        self.said, self.port = "", 0
        for line in self.process.stdout:
            if line.startswith("http://127.0.0.1:"):
                self.port = int(line.strip().rstrip("/").rsplit(":", 1)[1])
                return
            self.said += line

    def submit(self):
        """(status, job or error)"""
        status, body = self.send("rig", [("file", "a.glb", self.RIG), ("options", None, self.OPTIONS)])
        return status, json.loads(body)

    def jobs(self):
        return {job["id"]: job for job in json.loads(self.ask("GET", "/v1/jobs")[1])["jobs"] if job["kind"] == "rig"}

    def no_pictures(self):
        """Without the image of the first start, which takes long."""
        for job in json.loads(self.ask("GET", "/v1/jobs")[1])["jobs"]:
            if job["kind"] == "generation":
                self.ask("DELETE", "/v1/jobs/" + job["id"])

    def ended(self):
        until = time.monotonic() + 60
        while any(job["state"] in ("queued", "running") for job in self.jobs().values()):
            require(time.monotonic() < until, "jobs did not end")
            time.sleep(0.02)
        return self.jobs()

    def stop(self):
        self.process.send_signal(signal.SIGINT)
        return finish(self.process, 60)


class StudioTrial(Trial):
    """`accepted`: jobs that must end well; `program`: of the studio."""

    def __init__(self, program, folder, randomness):
        super().__init__(Command("studio", [], ["jobs/*/rigged.glb"], []), {}, 1.0, folder, randomness)
        self.program, self.accepted = program, []

    def open(self):
        studio = Studio(self.program, self.out)
        if not studio.port:
            raise Wrong(f"the studio did not start: {studio.said or finish(studio.process)}")
        studio.no_pictures()
        return studio

    def send(self, studio, count=3):
        for _ in range(count):
            status, job = studio.submit()
            require(status == 201, f"a job was refused: {job}")
            self.accepted.append(job["id"])

    def finishes(self):
        studio = self.open()
        self.send(studio, 1)
        jobs = studio.ended()
        for id in self.accepted:
            state = jobs.get(id, {"state": "lost", "error": ""})
            require(state["state"] == "done", f"job {id} is {state['state']}: {state['error']}")
        status, said = studio.stop()
        require(status == 0, f"Ctrl-C gives {status}: {said[-300:]}")
        check_files(self.out)
        rigs = [self.out / "jobs" / id / "rigged.glb" for id in self.accepted]
        require(all(rig.exists() for rig in rigs), "a job that ended has no rig")
        glb = {rig.read_bytes() for rig in rigs}
        require(len(glb) == 1, "the same job gave different rigs")
        found = self.command.contents(self.out)
        return sum(self.sizes[name] for name, value in self.kept.items() if found.get(name) != value)

    def after_fault(self):
        self.whole = self.command.contents(self.out)
        super().after_fault()

    def killed_half_way(self):
        studio = self.open()
        self.send(studio)
        time.sleep(self.random.uniform(0.0, 0.8))
        check_words(kill(studio.process)[1])
        self.after_fault()


def studio_full(trial):
    if not trial.mount(8 << 20):
        return
    studio = trial.open()
    filler = trial.out / "filler"
    left = os.statvfs(trial.out)
    size = left.f_bavail * left.f_frsize - trial.random.choice([0, 8192, 32768])
    filler.write_bytes(b"x" * size)
    status, answer = studio.submit()
    if status == 201:
        job = studio.ended()[answer["id"]]
        require(job["state"] in ("done", "failed"), f"the job is {job['state']}")
        trial.said = job["error"]
        if job["state"] == "failed":
            require("No space left" in job["error"], job["error"])
    else:
        trial.said = answer["error"]
        require(500 <= status < 600 and "No space left" in answer["error"], f"{status} {answer}")
    check_files(trial.out)
    filler.unlink()
    trial.remount("size=64m")
    status, said = studio.stop()
    require(status == 0, f"Ctrl-C gives {status}: {said[-300:]}")
    trial.after_fault()


def studio_read_only(trial):
    if trial.mount(8 << 20):
        trial.remount("ro")
    else:
        trial.out.chmod(0o555)
    studio = Studio(trial.program, trial.out)
    status, said = finish(studio.process, 30) if not studio.port else studio.stop()
    trial.said = studio.said + said
    trial.failed_clearly(status, "Read-only file system", "Permission denied")
    trial.after_fault()
    if trial.mounted:
        trial.remount("rw")
    else:
        trial.out.chmod(0o755)


def studio_vanishes(trial):
    """The upload of a job is removed while it waits or runs."""
    studio = trial.open()
    trial.send(studio)
    victim = trial.accepted.pop()
    (trial.out / "jobs" / victim / "input.glb").unlink(missing_ok=True)
    job = studio.ended()[victim]
    require(job["state"] == "done" or "input" in job["error"], f"{job['state']}: {job['error']}")
    trial.said = job["error"]
    studio.stop()
    trial.after_fault()


def studio_together(trial):
    studio = trial.open()
    trial.send(studio)
    second = Studio(trial.program, trial.out)
    status, said = finish(second.process, 30) if not second.port else second.stop()
    trial.said = second.said + said
    trial.failed_clearly(status, "another", "process", "studio")
    studio.ended()
    studio.stop()
    trial.after_fault()


def studio_power(trial):
    """Jobs that were accepted before are there."""
    def work(out, position):
        trial.out, accepted = out, {}
        studio = trial.open()
        for _ in range(3):
            trial.send(studio, 1)
            accepted[trial.accepted[-1]] = position()
        studio.ended()
        status, said = studio.stop()
        require(status == 0, f"Ctrl-C gives {status}: {said[-300:]}")
        return trial.command.contents(out), accepted
    count, accepted = lose_power(trial, work)
    log = RECORDED[trial.command.name].log
    trial.accepted = [id for id, position in accepted.items() if log.count(position) <= count]


STUDIO_FAULTS = {"disk full": studio_full, "read-only folder": studio_read_only, "input vanishes": studio_vanishes,
                 "two at once": studio_together, "power loss": studio_power}


# --- All -------------------------------------------------------------------------------------------------------------


def works(bin, source, folder, quick):
    """The commands, after what they start from was made."""
    data = folder / "data"
    prepare = [bin / "anigen-prepare", "--quiet", "--procedural", "3", "--procedural-test", "1", "--views", "1", "--view-size",
               "32", "--cond-views", "1", "--cond-view-size", "24", "--workers", "1"]
    made = subprocess.run([*prepare, "--output", data], capture_output=True, text=True)
    assert made.returncode == 0, made.stdout + made.stderr
    rigs, meshes = folder / "rigs", folder / "meshes"
    for place in (rigs, meshes):
        place.mkdir()
    for number, file in enumerate(sorted((data / "assets").glob("*.glb"))):
        shutil.copy(file, rigs / f"rig{number}.glb")
        shutil.copy(file, meshes / f"mesh{number}.glb")
    (folder / "experiment.json").write_text(json.dumps(EXPERIMENT))
    shutil.copy(source / "examples/creatures/bird.png", folder / "picture.png")
    steps = 2 if quick else 12
    train = [bin / "anigen-train", "--quiet", "--config", source / "configs/tiny/skin_ae.json", "--dataset", data, "--output",
             "{out}", "--threads", "1"]
    for key, value in (("max_steps", steps), ("i_save", steps // 2 if quick else steps // 3), ("i_sample", 0), ("i_eval", 0), ("i_log", 1)):
        train += ["--set", f"trainer.args.{key}={value}"]
    return [
        Command("preparation", [bin / "anigen-prepare", "--quiet", "--input", rigs, "--views", "1", "--view-size", "32",
                                "--cond-views", "1", "--cond-view-size", "24", "--workers", "1", "--output", "{out}"],
                ["**/*"], sorted(rigs.iterdir()), ["--seed", "7"]),
        # The last step alone: one that is killed while it removes old checkpoints leaves them.
        Command("training", train, [f"ckpts/model_*{steps:07}.safetensors"], [data / "metadata.csv", data / "skeleton"]),
        Command("experiment", [bin / "anigen-experiment", "run", "--quiet", folder / "experiment.json", "--output", "{out}"],
                ["jobs/rigged-*/**/*.glb", "jobs/dataset-*/assets/*.glb"], [folder / "experiment.json"]),
        Command("generation", [bin / "anigen-generate", "--quiet", "--image", folder / "picture.png", "--output", "{out}",
                               "--ss-steps", "2", "--slat-steps", "1", "--texture-size", "0", "--threads", "1"],
                ["**/*.glb", "**/*.png"], [folder / "picture.png"], ["--seed", "7"]),
        Command("rig", [bin / "anigen-rig", "--quiet", "--method", "nearest", "--mesh", meshes, "--output", "{out}"],
                ["**/*.glb"], sorted(meshes.iterdir())),
    ]


PROGRAMS = ["preparation", "training", "experiment", "generation", "rig", "studio"]
QUICK = {"preparation": {"SIGKILL", "input vanishes", "clock jumps"}, "training": {"SIGKILL"},
         "rig": {"disk full", "read-only folder", "two at once", "power loss"},
         "studio": {"SIGKILL", "disk full", "two at once", "leases of a lost machine", "power loss"}}


def run_trials(results, name, fault, make, disturb, count, places):
    for number in range(count):
        trial, problem, lost = make(), "", 0
        began = time.monotonic()
        try:
            disturb(trial)
            lost = trial.lost
            lost += trial.finishes()
            require(lost == 0, f"{lost} bytes were lost")
        except Wrong as error:
            problem = f"{error} ({trial.moment})" if trial.moment else str(error)
        finally:
            trial.close()
        results.add(trial, name, fault, number, time.monotonic() - began, problem, lost, [trial.out, *places])


def undisturbed(command, folder):
    """(contents, seconds) of the run that the others are compared with."""
    whole = folder / f"{command.name}-whole"
    began = time.monotonic()
    status, said = command.run(whole)
    assert status == 0, f"{command.name}: {said}"
    seconds, contents = time.monotonic() - began, command.contents(whole)
    assert contents, f"{command.name} has no results"
    print(f"{command.name}: {len(contents)} files, {bytes_below(whole)} bytes, {seconds:.2f} s", flush=True)
    return contents, seconds


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("bin", type=lambda text: pathlib.Path(text).resolve())
    parser.add_argument("source", type=lambda text: pathlib.Path(text).resolve())
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--program", action="append", choices=PROGRAMS)
    parser.add_argument("--fault", action="append", choices=[fault for fault, _, _ in FAULTS])
    parser.add_argument("--trials", type=int, default=0)
    parser.add_argument("--seed", type=int, default=None)
    parser.add_argument("--output", type=pathlib.Path)
    arguments = parser.parse_args()
    in_own_mounts()
    os.environ.setdefault("ANIGEN_WEIGHTS", str(arguments.source / "weights/anigen-small"))
    seed = arguments.seed if arguments.seed is not None else random.SystemRandom().randrange(1 << 30)
    randomness = random.Random(seed)
    print(f"seed {seed}", flush=True)
    results = Results(arguments.output, PROGRAMS, [fault for fault, _, _ in FAULTS])
    with tempfile.TemporaryDirectory(prefix="anigen-faults-") as place:
        folder = pathlib.Path(place)
        numbers = iter(range(10**9))
        places = [folder, arguments.source]
        faults = [fault for fault, _, _ in FAULTS]
        missing = left_out(folder)
        commands = works(arguments.bin, arguments.source, folder, arguments.quick)
        for command in [*commands, None]:
            name = command.name if command else "studio"
            if name not in (arguments.program or (QUICK if arguments.quick else PROGRAMS)):
                continue
            if command:
                contents, seconds = undisturbed(command, folder)
                make = lambda: Trial(command, contents, seconds, folder / f"t{next(numbers)}", randomness)
            else:
                Studio.RIG = (folder / "rigs/rig0.glb").read_bytes()
                make = lambda: StudioTrial(arguments.bin / "anigen-studio", folder / f"t{next(numbers)}", randomness)
            for fault, disturb, count in FAULTS:
                if fault not in (arguments.fault or (QUICK.get(name, ()) if arguments.quick else faults)):
                    continue
                if missing & {(name, fault), ("", fault.split(",")[0])} or (fault == REPLACING and not (command and command.other)):
                    continue
                disturb = disturb if command else STUDIO_FAULTS.get(fault, disturb)
                run_trials(results, name, fault, make, disturb, arguments.trials or (1 if arguments.quick else count), places)
                results.write()
    print(results.table())
    for problem in results.problems:
        print("FAILED:", problem)
    return 1 if results.problems else 0


if __name__ == "__main__":
    sys.exit(main())
