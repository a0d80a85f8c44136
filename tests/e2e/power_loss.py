#!/usr/bin/env python3
"""Power loss: a file system that records what programs change on it, and a model of what a disk holds of that afterwards.
As a program: power_loss.py BACKING MOUNT LOG is that file system.

Recorder mounts a pass-through file system (FUSE). History takes the first operations of its log and draws states in which
the power may have left the disk. The model is as harsh as POSIX allows, and no harsher than file systems with a journal:

- Data of a file is on the disk up to its last fsync. What was written later is there, missing, there in part, or zeros.
- A name (create, rename, unlink, mkdir, …) is on the disk once its folder was synced. Of the later operations either the
  first ones are, in their order (a journal; it has all that came before a sync of any folder), or any of them. Each has
  happened or has not, and none without those that it builds on: a file in a folder that got lost is lost, too."""
import bisect
import contextlib
import functools
import importlib
import os
import pathlib
import pickle
import shutil
import subprocess
import sys
import time

sys.dont_write_bytecode = True
MODULES = ("fusepy", "fuse")  # names of the same module in Debian and on PyPI
ROOT = ("folder", 0)
PAGE = 4096


# --- The file system, in a process of its own -------------------------------------------------------------------------


class PassThrough:
    """Operations for fusepy. Files have numbers of their own, since a disk uses those of removed files again."""
    use_ns = True
    flag_nullpath_ok = 1  # a file that is open stays usable without a name

    def __init__(self, backing, log):
        self.backing, self.log = backing, open(log, "wb", buffering=0)
        self.made, self.numbers, self.opened = 0, {}, {}

    def __call__(self, operation, *arguments):
        return getattr(self, operation)(*arguments)

    def note(self, *record):
        self.log.write(pickle.dumps(record))

    def at(self, path):
        return self.backing + path

    def getattr(self, path, handle=None):
        status = os.fstat(handle) if handle else os.lstat(self.at(path))
        found = {key: getattr(status, key) for key in ("st_mode", "st_ino", "st_nlink", "st_uid", "st_gid", "st_size", "st_blocks")}
        return {**found, **{key: getattr(status, key + "_ns") for key in ("st_atime", "st_mtime", "st_ctime")}}

    def statfs(self, path):
        status = os.statvfs(self.at(path))
        return {key: getattr(status, key) for key in dir(status) if key.startswith("f_")}

    def readdir(self, path, handle):
        return [".", "..", *os.listdir(self.at(path))]

    def readlink(self, path):
        return os.readlink(self.at(path))

    def create(self, path, mode):
        handle = os.open(self.at(path), os.O_RDWR | os.O_CREAT | os.O_EXCL, mode)
        self.made += 1
        self.opened[handle] = self.numbers[os.fstat(handle).st_ino] = self.made
        self.note("create", path, self.made)
        return handle

    def open(self, path, flags):
        # The kernel says where to write, also for O_APPEND.
        handle = os.open(self.at(path), flags & (os.O_RDONLY | os.O_WRONLY | os.O_RDWR))
        self.opened[handle] = self.numbers[os.fstat(handle).st_ino]
        return handle

    def release(self, path, handle):
        del self.opened[handle]
        os.close(handle)

    def read(self, path, size, offset, handle):
        return os.pread(handle, size, offset)

    def write(self, path, data, offset, handle):
        written = os.pwrite(handle, data, offset)
        self.note("write", self.opened[handle], offset, data[:written])
        return written

    def truncate(self, path, size, handle=None):
        os.truncate(handle or self.at(path), size)
        number = self.opened[handle] if handle else self.numbers[os.stat(self.at(path)).st_ino]
        self.note("truncate", number, size)

    def fsync(self, path, only_data, handle):
        self.note("fsync", self.opened[handle])

    def fsyncdir(self, path, only_data, handle):
        if path is not None:
            self.note("fsyncdir", path)

    def mkdir(self, path, mode):
        os.mkdir(self.at(path), mode)
        self.note("mkdir", path)

    def rename(self, old, new):
        os.rename(self.at(old), self.at(new))
        self.note("rename", old, new)

    def unlink(self, path):
        os.unlink(self.at(path))
        self.note("unlink", path)

    def rmdir(self, path):
        os.rmdir(self.at(path))
        self.note("rmdir", path)

    def link(self, new, old):
        os.link(self.at(old), self.at(new))
        self.note("link", old, new)

    def symlink(self, path, target):
        os.symlink(target, self.at(path))
        self.note("symlink", path, target)

    # Times and modes decide nothing here: a state that is drawn has the modes of new files.
    def chmod(self, path, mode):
        os.chmod(self.at(path), mode)

    def chown(self, path, user, group):
        os.chown(self.at(path), user, group)

    def utimens(self, path, times):
        os.utime(self.at(path), ns=times)


def fuse_module():
    for name in MODULES:
        with contextlib.suppress(ImportError, OSError):
            module = importlib.import_module(name)
            if hasattr(module, "FUSE"):
                return module
    return None


def serve(backing, mount, log):
    os.umask(0)
    with contextlib.suppress(RuntimeError):  # libfuse has said what is wrong
        # hard_remove: else a file that is open is not replaced by one rename but by two.
        fuse_module().FUSE(PassThrough(backing, log), mount, foreground=True, nothreads=True, use_ino=True,
                           hard_remove=True, big_writes=True, allow_other=os.geteuid() == 0)


# --- Recording --------------------------------------------------------------------------------------------------------


@functools.lru_cache
def python_with_fuse():
    """A Python that has the module; None: there is none."""
    folder = os.path.dirname(os.path.abspath(__file__))
    probe = f"import sys; sys.path.insert(0, {folder!r}); import power_loss; sys.exit(not power_loss.fuse_module())"
    for python in (sys.executable, "/usr/bin/python3"):
        with contextlib.suppress(OSError):
            if subprocess.run([python, "-B", "-c", probe], stderr=subprocess.DEVNULL).returncode == 0:
                return python
    return None


class Recorder:
    """The recording file system in `folder`; programs work below `mount`."""

    def __init__(self, folder):
        self.mount, backing, self.log, self.said = (folder / name for name in ("mount", "backing", "log", "said"))
        self.mount.mkdir(parents=True)
        backing.mkdir()
        command = [python_with_fuse(), "-B", os.path.abspath(__file__), backing, self.mount, self.log]
        with open(self.said, "w") as said:
            self.server = subprocess.Popen(command, stdin=subprocess.DEVNULL, stderr=said, start_new_session=True)
        until = time.monotonic() + 20
        while not os.path.ismount(self.mount):
            if self.server.poll() is not None or time.monotonic() > until:
                self.server.kill()
                raise OSError(f"cannot mount: {self.said.read_text().strip()[-200:] or 'no answer'}")
            time.sleep(0.01)

    def position(self):
        """Where the log is now: what a program has done is in it before the program goes on."""
        return self.log.stat().st_size

    def close(self):
        """@return what was recorded"""
        command = ["umount"] if os.geteuid() == 0 else ["fusermount", "-u"]
        for wait in (0, 0.2, 1):
            time.sleep(wait)
            if subprocess.run([*command, self.mount], stderr=subprocess.DEVNULL).returncode == 0:
                break
        else:
            subprocess.run(["umount", "-l", self.mount])
        try:
            self.server.wait(20)
        except subprocess.TimeoutExpired:
            self.server.kill()
        assert not self.said.read_text(), self.said.read_text()
        return Log(self.log)


class Log:
    """Operations that changed something, in their order."""

    def __init__(self, file):
        self.records, self.ends = [], []
        with open(file, "rb") as log, contextlib.suppress(EOFError):
            while True:
                self.records.append(pickle.load(log))
                self.ends.append(log.tell())

    def count(self, position):
        """Operations before a position()."""
        return bisect.bisect_right(self.ends, position)

    def text(self, index):
        return " ".join(f"{len(word)} bytes" if isinstance(word, bytes) else str(word) for word in self.records[index])


def unsupported(folder):
    """A reason why nothing can be recorded here; "": it can."""
    if python_with_fuse() is None:
        return "python3-fusepy is not installed"
    try:
        os.close(os.open("/dev/fuse", os.O_RDWR))
        Recorder(folder).close()
    except OSError as error:
        return f"/dev/fuse: {error.strerror}" if error.strerror else str(error)
    return ""


# --- The model --------------------------------------------------------------------------------------------------------


class Change:
    """An operation on names, which are pairs (folder, name). `needs`: the changes that it builds on, by their numbers.
    `folders`: those it works in."""

    def __init__(self, remove, add, node, needs, folders):
        self.remove, self.add, self.node, self.needs, self.folders = remove, add, node, needs, folders


def write_into(content, record, size=None):
    """Applies a record of data, or of a write the first bytes."""
    if record[0] == "truncate":
        content.extend(bytes(max(0, record[2] - len(content))))
        del content[record[2]:]
    else:
        offset, data = record[2], record[3][:size]
        content.extend(bytes(max(0, offset - len(content))))
        content[offset:offset + len(data)] = data


class History:
    """Some operations of a log as changes of a disk that was empty."""

    def __init__(self, records):
        self.changes, self.synced = [], set()  # `synced`: numbers of the changes that cannot be lost
        self.in_order = 0                      # a journal has these first changes
        self.data, self.synced_data = {}, {}   # by files: records, and how many of them cannot be lost
        self.made_by = {}                      # changes that made folders
        self.names, self.last, self.waiting = {}, {}, {}
        for record in records:
            self.take(record)

    def take(self, record):
        kind = record[0]
        if kind in ("write", "truncate"):
            self.data.setdefault(record[1], []).append(record)
        elif kind == "fsync":
            self.synced_data[record[1]] = len(self.data.get(record[1], ()))
        elif kind == "fsyncdir":
            self.in_order = len(self.changes)
            for number in self.waiting.pop(self.node(record[1]), ()):
                self.sync(number)
        else:
            self.change(kind, *record[1:])

    def key(self, path):
        folder, name = os.path.split(path)
        return self.node(folder), name

    def node(self, path):
        return ROOT if path == "/" else self.names[self.key(path)]

    def change(self, kind, path, *rest):
        remove, add, node, number = [], None, None, len(self.changes)
        if kind in ("unlink", "rmdir", "rename"):
            remove, node = [self.key(path)], self.node(path)
        if kind in ("link", "rename"):
            add, node = self.key(rest[0]), self.node(path)
        elif kind in ("create", "symlink", "mkdir"):
            add = self.key(path)
            node = {"create": ("file", *rest), "symlink": ("link", *rest, number), "mkdir": ("folder", number + 1)}[kind]
        keys = remove + ([add] if add else []) + ([self.key(path)] if kind == "link" else [])
        gone = node if kind == "rmdir" else self.names.get(add) if kind == "rename" else None
        if gone and gone[0] == "folder":  # only an empty one can go
            keys += [key for key in self.last if key[0] == gone]
        needs = {self.last[key] for key in keys if key in self.last}
        folders = {key[0] for key in remove + ([add] if add else [])}
        self.changes.append(Change(remove, add, node, needs, folders))
        for key in remove:
            del self.names[key]
            self.last[key] = number
        if add:
            self.names[add] = node
            self.last[add] = number
        if kind == "mkdir":
            self.made_by[node] = number
        for folder in folders:
            self.waiting.setdefault(folder, []).append(number)

    def sync(self, number):
        if number not in self.synced:
            self.synced.add(number)
            for other in self.changes[number].needs:
                self.sync(other)

    def tree(self, chosen):
        """{path: node} when these changes reached the disk."""
        done, entries = set(), {ROOT: {}}
        for number in sorted(chosen):
            change = self.changes[number]
            if not change.needs <= done or any(folder not in entries for folder in change.folders):
                continue
            done.add(number)
            for folder, name in change.remove:
                del entries[folder][name]
            if change.add:
                entries[change.add[0]][change.add[1]] = change.node
            if self.made_by.get(change.node) == number:
                entries[change.node] = {}
        found = {}

        def visit(folder, path):
            for name, node in entries[folder].items():
                found[path + name] = node
                if node[0] == "folder":
                    visit(node, path + name + "/")
        visit(ROOT, "")
        return found

    def content(self, number, randomness=None):
        """Bytes of a file: those that were written, or what of them a disk may have."""
        records = self.data.get(number, [])
        synced = self.synced_data.get(number, 0) if randomness else len(records)
        content, later = bytearray(), records[synced:]
        for record in records[:synced]:
            write_into(content, record)
        if not later:
            return bytes(content)
        kind = randomness.choice(["nothing", "all", "part", "zeros"])
        count = {"nothing": 0, "all": len(later)}.get(kind, randomness.randint(0, len(later)))
        after = bytearray(content)
        for record in later[:count]:
            write_into(after, record)
        if kind == "part" and count < len(later) and later[count][0] == "write":
            write_into(after, later[count], randomness.randint(0, len(later[count][3])))
        if kind != "zeros":
            return bytes(after)
        content.extend(bytes(max(0, len(after) - len(content))))
        del content[len(after):]
        share = randomness.choice([0, randomness.random()])
        for page in range(0, len(after), PAGE):
            if randomness.random() < share:
                content[page:page + PAGE] = after[page:page + PAGE]
        return bytes(content)

    def files(self):
        """{path: bytes} of a disk that lost nothing."""
        return {path: self.content(node[1]) for path, node in self.tree(range(len(self.changes))).items() if node[0] == "file"}

    def certain(self):
        """{path: bytes} of the files that cannot be lost."""
        now = self.tree(range(len(self.changes)))
        return {path: self.content(node[1]) for path, node in self.tree(self.synced).items()
                if node[0] == "file" and now.get(path) == node
                and self.synced_data.get(node[1], 0) == len(self.data.get(node[1], ()))}

    def draw(self, randomness, harshest=False):
        """A state that the power may leave: {path: node} and {file: bytes}; `harshest`: only the names that are certain."""
        everything = range(len(self.changes))
        if harshest:
            chosen = self.synced
        elif randomness.random() < 1 / 3:
            chosen = set(range(randomness.randint(self.in_order, len(self.changes))))
        else:
            share = randomness.choice([0, 0, randomness.random(), randomness.random(), 1])
            chosen = self.synced | {number for number in everything if randomness.random() < share}
        tree = self.tree(chosen)
        return tree, {node: self.content(node[1], randomness) for node in tree.values() if node[0] == "file"}


def lay_out(state, folder):
    """Makes a state in a folder, which loses what it had."""
    tree, contents = state
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    first = {}  # names of files, for those that have several
    for path, node in sorted(tree.items()):
        place = folder / path
        if node[0] == "folder":
            place.mkdir()
        elif node[0] == "link":
            place.symlink_to(node[1])
        elif node in first:
            os.link(first[node], place)
        else:
            first[node] = place
            place.write_bytes(contents[node])


class Recorded:
    """A run of a program on the recording file system, in the folder `out`. Every trial loses the power of one."""

    def __init__(self, folder, work):
        """@param work gets `out` and position(); @return of it is kept as `told`"""
        recorder = Recorder(folder)
        self.out, self.drawn = recorder.mount / "out", 0
        try:
            self.told = work(self.out, recorder.position)
        finally:
            self.log = recorder.close()

    def lose_power(self, randomness):
        """Leaves in `out` what a disk may have, every fourth time at the end of the run, and the least first.
        @return operations before that, {name: bytes} of the files that must be there, words for the moment"""
        whole = len(self.log.records)
        count = whole if self.drawn % 4 == 0 else randomness.randrange(whole)
        history = History(self.log.records[:count])
        lay_out(history.draw(randomness, self.drawn == 0), self.out.parent)
        self.drawn += 1
        files = history.files() if count == whole else history.certain()
        must = {path.removeprefix("out/"): content for path, content in files.items() if path.startswith("out/")}
        return count, must, f"power lost after operation {count} of {whole}" + (f", {self.log.text(count - 1)}" if count else "")



if __name__ == "__main__":
    serve(*sys.argv[1:])
