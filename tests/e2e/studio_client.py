"""Requests to a studio on this machine, and a mesh to send, for the tests that speak HTTP with it."""
import http.client
import math
import pathlib


def form(parts):
    """Parts (name, file name or None, content) as a multipart body."""
    body = b""
    for name, file, content in parts:
        head = f'--b\r\nContent-Disposition: form-data; name="{name}"' + (f'; filename="{file}"' if file else "")
        body += head.encode() + b"\r\n\r\n" + content + b"\r\n"
    return body + b"--b--\r\n"


def tube(rings, sides, length):
    """A closed tube along X as the bytes of an .obj."""
    lines = []
    for r in range(rings):
        for s in range(sides):
            a = 2 * math.pi * s / sides
            lines.append(f"v {r / rings * length} {0.08 * math.cos(a)} {0.08 * math.sin(a)}")
    for r in range(rings - 1):
        for s in range(sides):
            a, b = r * sides + s + 1, r * sides + (s + 1) % sides + 1
            lines.append(f"f {a} {b} {b + sides} {a + sides}")
    lines.append("f " + " ".join(str(s + 1) for s in reversed(range(sides))))
    lines.append("f " + " ".join(str((rings - 1) * sides + s + 1) for s in range(sides)))
    return ("\n".join(lines) + "\n").encode()


def children(pid):
    """Processes that a process has started and that still run, the latest last."""
    found = []
    for task in pathlib.Path(f"/proc/{pid}/task").glob("*/children"):
        try:
            found += [int(word) for word in task.read_text().split()]
        except OSError:
            pass
    return sorted(found)


class StudioClient:
    """`port` is set by who starts the studio."""
    port = 0

    def ask(self, method, path, body=None, headers=None):
        """(status, body of the answer)"""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        try:
            connection.request(method, path, body, headers or {})
            answer = connection.getresponse()
            return answer.status, answer.read()
        finally:
            connection.close()

    def send(self, kind, parts):
        """Sends a job of a kind, such as "rig"."""
        return self.ask("POST", f"/v1/3d/{kind}s", form(parts), {"Content-Type": "multipart/form-data; boundary=b"})
