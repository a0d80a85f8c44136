"""Checks of files that programs leave and of what they say, file systems to try them on, and tables of trials, for the tests
of faults."""
import csv
import json
import os
import re
import shutil
import struct
import subprocess
import sys
import zipfile

from power_loss import unsupported

TEMPORARY = ".tmp-"
BAD_WORDS = ("terminate called", "Segmentation fault", "Assertion", "bad_alloc", "basic_string", "what():")


class Wrong(Exception):
    """A trial that ended as it must not."""


def require(condition, words):
    if not condition:
        raise Wrong(words)


def check_glb(data):
    magic, _, length = struct.unpack("<4sII", data[:12])
    assert magic == b"glTF" and length == len(data), "length of the header"
    at = 12
    while at < length:
        size, kind = struct.unpack("<II", data[at:at + 8])
        if kind == 0x4E4F534A:
            json.loads(data[at + 8:at + 8 + size])
        at += 8 + size
    assert at == length, "length of the chunks"


def check_safetensors(data):
    size = struct.unpack("<Q", data[:8])[0]
    head = json.loads(data[8:8 + size])
    ends = [value["data_offsets"][1] for key, value in head.items() if key != "__metadata__"]
    assert 8 + size + max(ends, default=0) == len(data), "length of the arrays"


def check_zip(file):
    with zipfile.ZipFile(file) as archive:
        assert archive.testzip() is None, "checksum"


CHECKS = {
    ".glb": lambda file: check_glb(file.read_bytes()),
    ".safetensors": lambda file: check_safetensors(file.read_bytes()),
    ".json": lambda file: json.loads(file.read_bytes()),
    ".npz": check_zip,
    ".png": lambda file: require(file.read_bytes()[-8:-4] == b"IEND", "end of the picture"),
}


def files_of(folder):
    """Files below a folder that have their final names."""
    return [file for file in sorted(folder.rglob("*")) if file.is_file() and TEMPORARY not in str(file.relative_to(folder))]


def check_files(folder):
    for file in files_of(folder):
        try:
            CHECKS.get(file.suffix, lambda _: None)(file)
        except Exception as error:  # whatever a reader of a damaged file throws
            raise Wrong(f"{file.relative_to(folder)} is not whole: {error!r}") from None


def bytes_below(folder):
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())


def message_of(said, folders):
    """The line that says what went wrong."""
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    line = next((line for line in reversed(lines) if re.search(r"error|cannot|no such file|shrank", line)), lines[-1] if lines else "")
    for folder in folders:
        line = line.replace(str(folder), "…")
    return re.sub(r"\b[0-9a-f]{64}\b", "ID", re.sub(r"\.tmp-\d+-\d+", ".tmp-N", line))


def check_words(said):
    for words in BAD_WORDS:
        require(words not in said, f"it says '{words}': {said[-300:]}")


def in_own_mounts():
    """Starts this program again in a mount namespace of its own, where that is allowed."""
    if os.geteuid() == 0 and "ANIGEN_OWN_MOUNTS" not in os.environ and shutil.which("unshare"):
        probe = subprocess.run(["unshare", "-m", "true"], stderr=subprocess.DEVNULL)
        if probe.returncode == 0:
            os.environ["ANIGEN_OWN_MOUNTS"] = "1"
            os.execvp("unshare", ["unshare", "-m", sys.executable, *sys.argv])


def left_out(folder):
    """(program, fault) that cannot be tried here; program "": of all."""
    missing = {}
    probe = folder / "probe"
    probe.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "none", probe], stderr=subprocess.DEVNULL).returncode == 0:
        subprocess.run(["umount", probe], check=True)
    else:
        missing["studio", "disk full"] = "no file system can be mounted here"
        if os.geteuid() == 0:  # the administrator writes into those, too
            missing["", "read-only folder"] = "no file system can be mounted here"
    reason = unsupported(folder / "recording-probe")
    if reason:
        missing["", "power loss"] = reason
    for (program, fault), reason in sorted(missing.items()):
        print(f"not supported: {fault} of {program or 'all programs'}: {reason}", flush=True)
    return set(missing)


COLUMNS = ["program", "fault", "trial", "seconds", "bytes_lost", "outcome", "says"]


class Results:
    """Trials of this call, and of earlier calls into the same folder with other programs and faults."""

    def __init__(self, folder, programs, faults):
        self.folder, self.programs, self.faults = folder, programs, faults  # in the order of the table
        self.trials, self.problems = [], []

    def add(self, trial, name, fault, number, seconds, problem, lost, places):
        if problem:
            self.problems.append(f"{name}, {fault}: {problem}")
            print("FAILED:", self.problems[-1], flush=True)
        self.trials.append(dict(zip(COLUMNS, [name, fault, number, f"{seconds:.2f}", lost, problem or "survived",
                                              message_of(trial.said, places)])))

    def table(self):
        groups = {}
        for trial in self.trials:
            groups.setdefault((trial["program"], trial["fault"]), []).append(trial)
        lines = ["| program | fault | trials | survived | bytes lost | says |", "|---|---|--:|--:|--:|---|"]
        for (program, fault), group in groups.items():
            survived = sum(trial["outcome"] == "survived" for trial in group)
            words = next((trial["says"] for trial in group if trial["says"]), "").replace("|", "\\|")
            lost = sum(int(trial["bytes_lost"]) for trial in group)
            lines.append(f"| {program} | {fault} | {len(group)} | {survived} | {lost} | {words or 'nothing'} |")
        return "\n".join(lines) + "\n"

    def write(self):
        if self.folder is None:
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        file = self.folder / "trials.csv"
        if file.exists():
            made = {(trial["program"], trial["fault"]) for trial in self.trials}
            with open(file, newline="") as old:
                self.trials += [trial for trial in csv.DictReader(old) if (trial["program"], trial["fault"]) not in made]
        self.trials.sort(key=lambda trial: (self.programs.index(trial["program"]), self.faults.index(trial["fault"])))
        with open(file, "w", newline="") as out:
            writer = csv.DictWriter(out, COLUMNS, lineterminator="\n")
            writer.writeheader()
            writer.writerows(self.trials)
        (self.folder / "table.md").write_text(self.table())
