#!/usr/bin/env python3
"""The model of a power loss against small writers: one that syncs what it should never loses or halves a file, one that
forgets a sync does so in some of 200 states. Status 77 where there is no FUSE."""
import fcntl
import mmap
import os
import pathlib
import random
import sys
import tempfile

sys.dont_write_bytecode = True  # the checkout stays as it is
from power_loss import PAGE, History, Recorder, lay_out, unsupported

TEXT = b"0123456789abcdef" * 1000  # of some pages


def put(file, data, sync):
    with open(file, "wb") as out:
        out.write(data[:5000])
        out.flush()
        out.write(data[5000:])
        out.flush()
        if sync:
            os.fsync(out.fileno())


def sync_folder(folder):
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    os.fsync(handle)
    os.close(handle)


def replace(folder, data=TEXT, file=True, entry=True):
    """Writes result.bin as programs should. `file`, `entry`: what is synced."""
    put(folder / "result.tmp", data, file)
    os.rename(folder / "result.tmp", folder / "result.bin")
    if entry:
        sync_folder(folder)


def in_new_folder(folder, parent):
    (folder / "new").mkdir()
    replace(folder / "new")
    if parent:
        sync_folder(folder)


def append(folder):
    with open(folder / "log.txt", "wb", buffering=0) as out:
        sync_folder(folder)
        out.write(TEXT)
        os.fsync(out.fileno())
        out.write(TEXT)
    with open(folder / "log.txt", "ab") as out:
        out.write(b"end")


def lease(folder):
    (folder / "new").write_bytes(b"me")
    os.link(folder / "new", folder / "piece.1")
    (folder / "new").unlink()
    sync_folder(folder)


def move_and_remove(folder):
    (folder / "a").mkdir()
    (folder / "b").mkdir()
    sync_folder(folder)
    put(folder / "a/one", TEXT, True)
    os.rename(folder / "a/one", folder / "b/two")
    sync_folder(folder / "b")
    (folder / "a").rmdir()
    sync_folder(folder)


def map_and_lock(folder):
    with open(folder / "mapped", "w+b") as out, open(folder / "mapped", "rb") as other:
        out.truncate(PAGE)
        fcntl.flock(out, fcntl.LOCK_EX)
        try:
            fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
            raise AssertionError("two hold one lock")
        except BlockingIOError:
            pass
        fcntl.lockf(out, fcntl.LOCK_EX | fcntl.LOCK_NB)
        with mmap.mmap(out.fileno(), PAGE) as memory:
            memory[:5] = b"start"
            memory.flush()
        os.fsync(out.fileno())
        os.unlink(folder / "mapped")
        out.write(b"without a name")
    (folder / "link").symlink_to("nowhere")
    sync_folder(folder)


class ModelTest:
    def __init__(self, folder):
        self.folder, self.random, self.runs = folder, random.Random(1), 0

    def states(self, writer, cut=False, count=200):
        """Files, {path: bytes}, of states in which a power loss after the writer leaves the disk; `cut`: at any moment."""
        self.runs += 1
        recorder = Recorder(self.folder / str(self.runs))
        try:
            writer(recorder.mount)
            position = recorder.position()
        finally:
            log = recorder.close()
        assert log.count(position) == len(log.records) > log.count(position - 1), "all is recorded when the writer goes on"
        found = []
        for _ in range(count):
            records = log.records[:self.random.randint(0, len(log.records))] if cut else log.records
            history = History(records)
            tree, contents = history.draw(self.random)
            state = {path: contents.get(node) for path, node in tree.items()}
            for path, content in history.certain().items():
                assert state.get(path) == content, f"{path} is certain, and yet lost"
            found.append(state)
        self.log, self.last = log, (tree, contents)
        return found

    def run(self):
        results = [state.get("result.bin") for state in self.states(lambda folder: replace(folder, file=False))]
        assert results.count(b"") > 5 and results.count(TEXT) > 5, "renamed without fsync: empty at times, whole at times"
        assert any(result and result != TEXT for result in results), "renamed without fsync: a part at times"

        results = [state.get("result.bin") for state in self.states(lambda folder: replace(folder, file=False, entry=False))]
        assert results.count(None) > 5 and results.count(b"") > 5, "without any fsync: missing or empty at times"

        assert all(state == {"result.bin": TEXT} for state in self.states(replace)), "with both: always there"
        assert {state.get("result.bin") for state in self.states(replace, cut=True)} == {None, TEXT}, "with both: never half"
        kinds = {record[0] for record in self.log.records}
        assert kinds == {"create", "write", "fsync", "rename", "fsyncdir"}, f"recorded {kinds}"

        results = [state.get("result.bin") for state in self.states(lambda folder: replace(folder, entry=False))]
        assert set(results) == {None, TEXT}, "without fsync of the folder: lost at times, never half"

        def twice(folder):
            replace(folder, b"old")
            replace(folder, TEXT, entry=False)
        results = [state.get("result.bin") for state in self.states(twice)]
        assert set(results) == {b"old", TEXT}, "replaced: the old or the new one"

        results = [state.get("new/result.bin") for state in self.states(lambda folder: in_new_folder(folder, False))]
        assert set(results) == {None, TEXT}, "a new folder that nobody synced: lost at times"
        assert all(state["new/result.bin"] == TEXT for state in self.states(lambda folder: in_new_folder(folder, True)))

        results = [state["log.txt"] for state in self.states(append)]
        assert all(result.startswith(TEXT) and len(result) <= 2 * len(TEXT) + 3 for result in results), "what was synced stays"
        assert TEXT in results and 2 * TEXT + b"end" in results and any(b"\0" in result for result in results)

        states = self.states(lease)
        assert all(set(state) == {"piece.1"} for state in states), "a second name whose first one is gone"
        assert {b"", b"m", b"me", b"\0\0"} == {state["piece.1"] for state in states}, "its data was not synced"
        states = self.states(move_and_remove)
        assert all(state == {"b": None, "b/two": TEXT} for state in states), "moved to another folder"
        assert any("a/one" in state for state in self.states(move_and_remove, cut=True))
        assert all(state == {"link": None} for state in self.states(map_and_lock)), "mapped, locked and removed"
        assert b"start" in [record[3][:5] for record in self.log.records if record[0] == "write"], "what was mapped is recorded"

        place = self.folder / "state"
        self.states(lambda folder: [put(folder / "a", TEXT, True), os.link(folder / "a", folder / "b"), sync_folder(folder)])
        lay_out(self.last, place)
        assert (place / "b").read_bytes() == TEXT and (place / "a").stat().st_nlink == 2, "laid out"


def main():
    with tempfile.TemporaryDirectory(prefix="anigen-power-loss-") as place:
        folder = pathlib.Path(place)
        reason = unsupported(folder / "probe")
        if reason:
            print("not supported:", reason)
            return 77
        ModelTest(folder).run()
    print("the model of a power loss works")
    return 0


if __name__ == "__main__":
    sys.exit(main())
