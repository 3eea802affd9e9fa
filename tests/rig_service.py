"""lightrigd as a script's child: a small rig, its control socket, its status. Used by the measuring commands beside it."""
import json
import os
import pathlib
import re
import signal
import socket
import subprocess
import time

HERE = pathlib.Path(__file__).resolve().parent.parent
CHANGE = "X-Lightrig: 1\r\nContent-Type: application/json\r\nX-Lightrig-Client: script\r\n"

# The demo's rig made small: whole sessions in about a second on a clock that jumps.
SMALL = {
    "width_px": "64", "height_px": "48", "fx_px": "348", "clock_rate": "inf", "shape": '"sphere"', "max_lights": "3",
    "count": "60", "exposures_s": "[80e-6, 1.28e-3, 20.48e-3]",
    "leave_out_families": '["coated", "fabric", "metal", "metallic-paint", "plastic", "powder", "retroreflector", "rubber", '
                          '"stone", "wood"]',
}


def write_rig(path, changes=None):
    """The demo's rig file with other values: the last line of each key is replaced."""
    text = (HERE / "config/demo.toml").read_text()
    text = text.replace('"controllers/', f'"{HERE}/config/controllers/')
    for key, value in (SMALL if changes is None else changes).items():
        found = list(re.finditer(rf"^{key} = .*$", text, re.M))
        assert found, f"the demo's rig file has no line {key}"
        text = text[:found[-1].start()] + f"{key} = {value}" + text[found[-1].end():]
    pathlib.Path(path).write_text(text)
    return path


class Gone(Exception):
    """The service no longer answers: it was killed, or has ended."""


class Service:
    """One lightrigd on a socket of its own."""

    connection = None
    used = 0.0  # when the kept connection was used last [s, monotonic]

    def __init__(self, build, rig, root, socket_path, *arguments, env=None, log_level="error", log=None):
        self.socket_path = str(socket_path)
        self.process = subprocess.Popen(
            [pathlib.Path(build) / "lightrigd", "--rig", rig, "--session-root", root, "--socket", self.socket_path,
             "--log-level", log_level, *arguments], env={**os.environ, **(env or {})}, stderr=log)

    def wait_until_up(self, seconds=60):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if self.process.poll() is not None:
                raise Gone(f"the service ended with {self.process.returncode}")
            try:
                self.connection, self.used = self.connect(), time.monotonic()
                return self
            except OSError:
                time.sleep(0.002)
        raise SystemExit("the service did not open its socket")

    def connect(self):
        s = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        s.settimeout(60)
        try:
            s.connect(self.socket_path)
        except OSError:
            s.close()
            raise
        return s

    def ask(self, method, path, body=None, connection=None):
        """One request on the kept connection: status code and parsed body."""
        if connection is None and time.monotonic() - self.used > 4:
            self.connection.close()  # the service drops who asks for nothing for 10 s
            try:
                self.connection = self.connect()
            except OSError as error:
                raise Gone(str(error)) from error
        s = connection or self.connection
        self.used = time.monotonic()
        text = json.dumps(body if body is not None else {})
        head = f"{method} {path} HTTP/1.1\r\nHost: x\r\n{CHANGE}"
        if method == "POST":
            head += f"Content-Length: {len(text)}\r\n"
        try:
            s.sendall((head + "\r\n" + (text if method == "POST" else "")).encode())
            data = b""
            while b"\r\n\r\n" not in data:
                data += self.more(s)
            head, _, rest = data.partition(b"\r\n\r\n")
            length = next(int(l.split(b":")[1]) for l in head.split(b"\r\n") if l.lower().startswith(b"content-length"))
            while len(rest) < length:
                rest += self.more(s)
        except OSError as error:
            raise Gone(str(error)) from error
        return int(head.split()[1]), json.loads(rest)

    @staticmethod
    def more(s):
        piece = s.recv(1 << 16)
        if not piece:
            raise Gone("the service closed the connection")
        return piece

    def status(self):
        return self.ask("GET", "/v1/status")[1]

    def wait_for(self, good, seconds=120, pause=0.004):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            status = self.status()
            if good(status):
                return status
            time.sleep(pause)
        raise SystemExit("the service did not get there: " + json.dumps(status, indent=1))

    def arm(self):
        """Armed and idle; --auto-arm, or somebody, may have begun it."""
        self.wait_for(lambda s: not s["busy"])
        self.ask("POST", "/v1/arm")
        return self.wait_for(lambda s: s["armed"] and not s["busy"])

    def stop(self, sig=signal.SIGTERM, seconds=60):
        """Its exit code; a service that does not end is killed and said so."""
        if self.connection is not None:
            self.connection.close()
        if self.process.poll() is None:
            self.process.send_signal(sig)
        try:
            return self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise SystemExit("the service did not end")
