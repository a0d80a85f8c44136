#!/usr/bin/env python3
"""Seconds from a command to its end, of every program on one asset, and where they go.

    start_up.py BIN --asset RIGGED.glb --image PICTURE.png [--rounds N] [--only WORD] [--output FILE.md]

BIN has the programs. Rows take turns, so that what else the machine does falls on all alike; medians of N rounds, files
in the page cache. *start*: `--help`, which loads no LibTorch. *LibTorch*: what `--version` takes longer. *work*: what the
command takes beyond its start, LibTorch included where it needs it. Needs nothing but Python."""
import argparse
import os
import pathlib
import shutil
import statistics
import subprocess
import sys
import tempfile
import time

MOST_SECONDS = 300


def measured(command, folder, until=None):
    """(wall seconds, processor seconds, peak MB) of a command; of one that serves, until it answers `until`."""
    with open(folder / "log.txt", "wb") as log:
        begin = time.perf_counter()
        process = subprocess.Popen([str(word) for word in command], stdin=subprocess.DEVNULL, stdout=log, stderr=log,
                                   cwd=folder, start_new_session=True)
        if until:
            while not until():
                if time.perf_counter() - begin > MOST_SECONDS or process.poll() is not None:
                    break
                time.sleep(0.005)
            wall = time.perf_counter() - begin
            process.terminate()
        _, status, usage = os.wait4(process.pid, 0)
        if not until:
            wall = time.perf_counter() - begin
    if not until and os.waitstatus_to_exitcode(status) != 0:
        raise SystemExit(f"{' '.join(map(str, command))}\nfailed:\n" + (folder / "log.txt").read_text()[-2000:])
    return wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def answers(port):
    import urllib.request

    def asked():
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=1) as reply:
                return reply.status == 200
        except OSError:
            return False
    return asked


def made(bin_folder, source, folder):
    """Files that commands read: a creature as mesh, rig and picture, and a dataset of three creatures."""
    run = lambda *command: subprocess.run([str(word) for word in command], check=True, cwd=folder,
                                          stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    run(bin_folder / "anigen-prepare", "--procedural", 3, "--seed", 1, "--only", "import,skeleton", "-o", "data")
    config = source / "configs/tiny/skin_ae.json"
    return {"data": folder / "data", "config": config}


def rows(bin_folder, source, folder, asset, picture):
    program = lambda name: bin_folder / f"anigen-{name}"
    files = made(bin_folder, source, folder)
    mesh = asset
    port = 18000 + os.getpid() % 20000
    yield "inspect", [program("inspect"), asset], None
    yield "rig, `--method heat` (own joints)", [program("rig"), "--method", "heat", "--mesh", mesh, "-o", "rigged.glb"], None
    yield "rig, without `--method`", [program("rig"), "--mesh", mesh, "-o", "auto.glb"], None
    yield "animate, a walk", [program("animate"), "--asset", asset, "--motion", "walk", "-o", "moved.glb"], None
    if program("mesh").exists():
        yield "mesh check", [program("mesh"), "check", asset], None
    yield "eval, one pair", [program("eval"), "--dataset", asset, "--pred", asset, "-o", "scores"], None
    yield "prepare, one asset", [program("prepare"), "--input", asset, "--only", "import,skeleton", "-o", "one"], None
    yield "train, the first step", [program("train"), "--config", files["config"], "--dataset", files["data"], "--output", "run",
                                    "--set", "trainer.args.max_steps=1", "--set", "dataset.args.split=",
                                    "--set", "dataset.args.eval_split="], None
    yield "generate, an image", [program("generate"), "--image", picture, "-o", "generated"], None
    if program("studio").exists():
        yield "studio, its page", [program("studio"), "--port", port], answers(port)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bin", type=pathlib.Path)
    parser.add_argument("--asset", type=pathlib.Path, required=True, help="rigged GLB")
    parser.add_argument("--image", type=pathlib.Path, required=True, help="picture of one object")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--only", default="", help="rows whose name contains this")
    parser.add_argument("--output", type=pathlib.Path, help="table as Markdown")
    arguments = parser.parse_args()
    bin_folder, source = arguments.bin.resolve(), pathlib.Path(__file__).resolve().parent.parent
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        table = [row for row in rows(bin_folder, source, folder, arguments.asset.resolve(), arguments.image.resolve())
                 if arguments.only in row[0]]
        kept = set(folder.iterdir())
        times = {}
        for turn in range(arguments.rounds + 1):  # the first one fills the page cache and does not count
            for title, command, until in table:
                parts = [measured([command[0], "--help"], folder), measured([command[0], "--version"], folder),
                         measured(command, folder, until)]
                for path in folder.iterdir():
                    if path in kept:
                        continue
                    if path.is_dir():
                        shutil.rmtree(path)
                    else:
                        path.unlink()
                if turn > 0:
                    times.setdefault(title, []).append(parts)
            print(f"round {turn} of {arguments.rounds}", file=sys.stderr)
    lines = ["| command | all, s | start | LibTorch | work | processor, s | peak MB |", "|---|--:|--:|--:|--:|--:|--:|"]
    for title, rounds in times.items():
        middle = lambda part, value: statistics.median(round[part][value] for round in rounds)
        start, loaded, whole = middle(0, 0), middle(1, 0), middle(2, 0)
        lines.append(f"| {title} | {whole:.2f} | {start:.3f} | {max(0.0, loaded - start):.2f} | "
                     f"{max(0.0, whole - start):.2f} | {middle(2, 1):.2f} | {middle(2, 2):.0f} |")
    print("\n".join(lines))
    if arguments.output:
        arguments.output.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
