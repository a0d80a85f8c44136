#!/usr/bin/env python3
"""Runs the commands that the pages print in fenced blocks, as they stand there but at their smallest setting.

    documentation_commands.py SOURCE BIN [PAGE…]

SOURCE is the checkout, BIN the folder of the programs. Every command of README.md and of the pages below is run, after
the substitutions of SMALLEST, in a folder where the files of the page's examples are (fixtures()), or it is named in
CANNOT_RUN with a reason. A command that fails, whose program is not one of ours, or that no page prints any more although
a table names it, fails the test."""
import os
import pathlib
import re
import resource
import shutil
import subprocess
import sys
import tempfile

PAGES = ["docs/getting_started.md", "docs/own_data.md", "docs/generation.md", "docs/rigging.md", "docs/engines.md",
         "docs/animation.md", "docs/evaluation.md", "docs/experiments.md", "docs/mesh-health.md", "docs/studio.md",
         "docs/library.md", "README.md"]
# The section whose commands make what the other pages start from.
FIRST = ("docs/getting_started.md", "All stages by hand")

# Commands that are not run: how they begin, and why.
CANNOT_RUN = [
    ("scripts/quickstart.sh", "installs packages and builds; e2e tests and .ci/run cover its experiment"),
    ("scripts/test.sh", "installs packages, builds and runs this test"),
    ("scripts/build.sh --programs release", "compiles everything"),
    ("cmake -", "e2e.installed_library installs, builds the examples against that and runs them"),
    ("xdg-open", "needs a desktop"),
    ("anigen-rig --method anymate --mesh rigs/ --skin-model bert-", "needs released weights"),
    ("anigen-eval --pred generated/ --dataset rigs/ --output results --lpips-weights", "needs VGG16's weights; vision tests use small ones"),
]

# Program, words of a command, what stands in their place. The first word that a program of ours has decides.
SMALLEST = [
    ("anigen-prepare", r"--procedural 28 --procedural-test 4", "--procedural 3 --procedural-test 1"),
    ("anigen-prepare", r"--views \d+", "--views 1"),
    ("anigen-prepare", r"--cond-views \d+", "--cond-views 1 --view-size 32 --cond-view-size 32"),
    ("anigen-prepare", r"--view-size (?!32)\d+", ""),
    ("anigen-prepare", r"--cond-view-size (?!32)\d+", ""),
    ("anigen-prepare", r"--augment \d+", "--augment 1 --test-count 1"),
    ("anigen-train", r"--set trainer\.args\.max_steps=\d+", ""),
    ("anigen-train", r"(configs/tiny/skin_ae\.json)", r"\1 {train}"),
    ("anigen-train", r"(configs/tiny32/ss_dae\.json)", r"\1 {train} --set dataset.args.resolution=8"),
    ("anigen-train", r"(configs/tiny32/ss_flow\.json)",
     r"\1 {train} --set models.denoiser.args.resolution=2 --set models.denoiser.args.patch_size=1"),
    ("anigen-train", r"(configs/tiny32/slat_dae\.json)",
     r"\1 {train} --set dataset.args.resolution=8 --set models.encoder.args.resolution=8"
     r" --set models.decoder.args.resolution=8"),
    ("anigen-train", r"(configs/tiny32/slat_flow\.json)", r"\1 {train} --set models.denoiser.args.resolution=8"),
    ("anigen-generate", r"(examples/creatures/bird\.png)", r"\1 --ss-steps 2 --slat-steps 1"),
    ("anigen-generate", r" --ss-steps \d+ --slat-steps \d+", ""),
    ("anigen-generate", r"(--slat-flow \S+)(?=.* --stop-at)", r"\1 --ss-steps 1 --threads 1"),
    ("anigen-generate", r"(--slat-flow \S+)(?=.* --voxels)", r"\1 --slat-steps 1 --texture-size 0 --threads 1"),
    ("anigen-generate", r"(--slat-flow \S+)(?!.* --(stop-at|voxels))",
     r"\1 --ss-steps 1 --slat-steps 1 --texture-size 0 --threads 1"),
    ("anigen-eval", r"(--ss-flow \S+)", r"\1 --ss-steps 1 --retrieval-views 1"),
    ("anigen-eval", r"articulation_xlv2_test\.npz", "rigs/"),
    ("anigen-eval", r"dance\.glb#Samba", "dance.glb"),
    ("anigen-eval", r"--motion-frames \d+", "--motion-frames 2"),
    ("anigen-eval", r"--motion-images \d+", "--motion-images 1"),
    ("anigen-eval", r"^(?!.*--protocol)(.*--pred .*)$", r"\1 --surface-samples 100 --rotations 1"),
    ("anigen-eval", r"^(?!.*--(?:protocol|metrics))(.*--pred .*)$", r"\1 --image-size 64"),
    ("anigen-rig", r"body\.obj", "body.ply"),
    ("anigen-rig", r"(--method anymate .*--joint-model \S+)", r"\1 --points 64"),
    ("anigen-experiment", r"run experiments/ablation_adapters\.json(?! --dry-run)", "run smallest.json"),
    ("anigen-experiment", r"(status|report|clean) experiments/ablation_adapters\.json", r"\1 smallest.json"),
    ("anigen-studio", r" --port \d+", ""),
    # It serves until it is told to end. The address is its one line.
    ("anigen-studio", r"^(anigen-studio.*)$",
     r"\1 --quiet > address & timeout 60 bash -c 'until grep -q ^http://127.0.0.1: address; do sleep 0.1; done';"
     r" kill -TERM $! && wait $!"),
    ("", r"~/\.local/share/bash-completion/completions/", ""),
    ("", r"&& man \./(\S+)", r"&& test -s \1"),
]
TRAIN = "--threads 1 --set trainer.args.max_steps=1 --set trainer.args.i_sample=0 --set trainer.args.i_eval=0"

# Trained models that rigging.md starts from: configs and run folders.
RIGGERS = {
    "configs/anymate_tiny/joints.json": "runs/joints",
    "configs/anymate_tiny/conn.json": "runs/conn",
    "configs/anymate_tiny/skin.json": "runs/skin",
    "configs/tiny/skin_correction.json": "runs/skin_correction",
    "configs/rignet_tiny/joints.json": "runs/rignet_joints",
    "configs/rignet_tiny/connectivity.json": "runs/rignet_connectivity",
    "configs/rignet_tiny/skin.json": "runs/rignet_skin",
}

SMALLEST_EXPERIMENT = """{
  "title": "Two creatures", "purpose": "a test",
  "steps": {
    "dataset": {"program": "anigen-prepare", "args": {"--procedural": 1, "--procedural-test": 1}},
    "rigged": {"program": "anigen-rig", "args": {"--method": "nearest", "--mesh": "{dataset}"}},
    "scores": {"program": "anigen-eval", "args": {"--pred": "nearest={rigged}", "--dataset": "{dataset}", "--surface-samples": 100,
               "--rotations": 1}}
  },
  "tables": [{"title": "Scores", "step": "scores", "columns": [{"key": "j2j", "better": "lower"}]}]
}
"""

BVH = """HIERARCHY
ROOT hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT chest
  {
    OFFSET 0 1 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 1 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.5
0 0 0 0 0 0 0 0 0
0 0 0 0 0 0 20 0 0
"""


def commands(text):
    """(section, command) of the fenced blocks of a page: lines joined where they end in a backslash, without comments."""
    section, block, found, line = "", None, [], ""
    for row in text.split("\n"):
        if row.startswith("```"):
            block = row[3:].strip() if block is None else None
            continue
        if block is None:
            if row.startswith("#"):
                section = row.lstrip("#").strip()
            continue
        if block not in ("", "sh"):
            continue
        line += row.rstrip()
        if line.endswith("\\"):
            line = line[:-1].rstrip() + " "
            continue
        line = re.sub(r"(^|\s)#(?!\S*').*$", "", line).strip()
        if line:
            found.append((section, re.sub(r"\s+", " ", line)))
        line = ""
    return found


def program_of(command):
    """The program of ours that a command calls, however it is written; None when it calls another."""
    for word in re.split(r"[\s;|&()]+", command):
        name = word.split("/")[-1]
        if re.fullmatch(r"anigen-[a-z]+", name):
            return name
    return None


def smallest(command):
    program = program_of(command)
    for name, pattern, instead in SMALLEST:
        if name in ("", program):
            changed = re.sub(pattern, instead, command)
            if changed != command:
                USED.add(pattern)
            command = changed
    return command.replace("{train}", TRAIN)


USED, FAILED = set(), []



def run(command, folder, env, shown):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(["bash", "-c", "set -eo pipefail; " + command], cwd=folder, env=env, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, text=True, errors="replace")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    print(f"{'ok  ' if done.returncode == 0 else 'FAIL'} {seconds:5.1f} s  {shown}", flush=True)
    if done.returncode != 0:
        FAILED.append(shown)
        print(f"     as: {command}\n     exit status {done.returncode}\n" + "\n".join("     " + l for l in done.stdout.split("\n")[-12:]))
    return done.returncode == 0


def link(target, name):
    name.parent.mkdir(parents=True, exist_ok=True)
    if not name.is_symlink():
        name.symlink_to(target)


def fixtures(work, env):
    """The files that the pages' examples name, from what the stages by hand left in work/runs."""
    data, made = work / "runs/data", work / "fixtures"
    made.mkdir()
    train = (data / "splits/train.txt").read_text().split()
    test = (data / "splits/test.txt").read_text().split()[0]
    for folder in ("rigs", "generated", "other", "meshes", "truth", "pictures", "weights", "frames"):
        (made / folder).mkdir()
    for name, asset in (("horse", train[0]), ("bird", test)):
        for folder in ("rigs", "generated", "other", "meshes"):
            shutil.copy(data / f"assets/{asset}.glb", made / folder / f"{name}.glb")
    for file, asset in (("statue.glb", train[0]), ("rig.glb", train[0]), ("dance.glb", train[1]), ("truth/fox.glb", test)):
        shutil.copy(data / f"assets/{asset}.glb", made / file)
    shutil.copy(data / f"renders/{train[0]}/mesh.ply", made / "body.ply")
    for picture in ("frog.png", "pictures/fox.png", "front.png", "side.png", "back.png", "frames/0000.png",
                    "frames/0001.png"):
        shutil.copy(data / f"renders_cond/{test}/000.png", made / picture)
    for asset in train + [test]:
        shutil.copy(data / f"skeleton/{asset}/skeleton_voxelized.npz", made / f"weights/{asset}.npz")
    # The first humanoid among procedural creatures.
    subprocess.run(["anigen-prepare", "--procedural", "16", "--procedural-test", "0", "--only", "import", "--only", "asset",
                    "--output", "heroes", "--quiet"], cwd=work, env=env, check=True, stdout=subprocess.DEVNULL)
    for hero in sorted((work / "heroes/assets").glob("*.glb")):
        command = ["anigen-rig", str(hero), "--method", "nearest", "--names", "vrm", "--output", str(work / "named.glb")]
        if subprocess.run(command, cwd=work, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode == 0:
            shutil.copy(hero, made / "hero.glb")
            break
    (made / "pairs.csv").write_text("pred,gt\nrigs/horse.glb,rigs/horse.glb\n")
    (made / "test.txt").write_text("horse\n")
    (made / "walk.bvh").write_text(BVH)
    (made / "smallest.json").write_text(SMALLEST_EXPERIMENT)
    for config, output in RIGGERS.items():
        run(f"anigen-train --config {config} --dataset runs/data --output {output} {TRAIN}"
            " --set trainer.args.eval_max_assets=1", work, env, f"fixture {output}")
    return made


def folder_of(page, work, made, source):
    """A folder for the commands of a page: the fixtures and, but for own_data.md, data and trained runs."""
    folder = work / page.replace("/", "_")
    folder.mkdir()
    for name in ("configs", "experiments", "scripts", "examples"):
        link(source / name, folder / name)
    link(work / "build", folder / "build")
    for entry in made.iterdir():
        link(entry, folder / entry.name)
    if page != "docs/own_data.md":
        link(work / "runs/data", folder / "data")
        for entry in (work / "runs").iterdir():
            link(entry, folder / "runs" / entry.name)
        link(source / "weights/anigen-small/matting", folder / "runs/matting")
    return folder


def main():
    source, programs = pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2]).resolve()
    if not (programs / "anigen-mesh").exists():  # built with CGAL alone
        PAGES.remove("docs/mesh-health.md")
    if not (programs / "anigen-studio").exists():  # built with cpp-httplib alone
        PAGES.remove("docs/studio.md")
    chosen = sys.argv[3:] or PAGES
    with tempfile.TemporaryDirectory(prefix="anigen-documentation-") as name:
        work = pathlib.Path(name)
        env = dict(os.environ, PATH=f"{programs}:{os.environ['PATH']}", OMP_WAIT_POLICY="passive", OMP_NUM_THREADS="1", HOME=name)
        for entry in ("configs", "experiments", "scripts"):
            link(source / entry, work / entry)
        link(programs, work / "build/release/bin")
        known = {page: commands((source / page).read_text()) for page in PAGES}
        made, reasons = None, set()
        for page in [FIRST[0]] + [p for p in PAGES if p in chosen]:
            first = made is None
            folder = work if first else folder_of(page, work, made, source)
            assigned = ""
            for section, command in known[page]:
                if ((page, section) == FIRST) != first:
                    continue
                if re.fullmatch(r"\w+=\S+", command):
                    assigned += command + "; "
                    continue
                plain = re.sub(r"(?:\$bin|build/release/bin)/", "", command)
                reason = next(((start, why) for start, why in CANNOT_RUN if plain.startswith(start)), None)
                shown = f"{page}: {command}"
                program = program_of(command)
                if reason:
                    reasons.add(reason[0])
                    print(f"not run: {shown} ({reason[1]})")
                elif program is None or not (programs / program).exists():
                    FAILED.append(shown)
                    print(f"FAIL {shown}\n     calls no program of ours; run it here or name it in CANNOT_RUN")
                else:
                    run(assigned + smallest(command), folder, env, shown)
            if first:
                made = fixtures(work, env)
        if chosen == PAGES:
            for start, _ in CANNOT_RUN:
                if start not in reasons:
                    FAILED.append(start)
                    print(f"FAIL no page prints '{start} …' any more: take it out of CANNOT_RUN")
            for _, pattern, _ in SMALLEST:
                if pattern not in USED:
                    FAILED.append(pattern)
                    print(f"FAIL no command has '{pattern}': take it out of SMALLEST")
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(f"{used.ru_utime + used.ru_stime:.0f} CPU-seconds, {len(FAILED)} failed")
    return 1 if FAILED else 0


sys.exit(main())
