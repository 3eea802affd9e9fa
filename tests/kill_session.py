"""Sessions that are disturbed, resumed and compared: what kill_matrix and disk_accidents share."""
import hashlib
import json
import shutil
import time

from rig_service import Gone, Service, write_rig

# Figures that a clock gave: they differ between any two runs.
TIMES = {"elapsed_s", "measured", "cost", "taken_at", "frame_id", "session", "created", "at"}


def plain(value):
    """A JSON value without what belongs to the moment."""
    if isinstance(value, dict):
        return {k: plain(v) for k, v in value.items() if k not in TIMES}
    if isinstance(value, list):
        return [plain(v) for v in value]
    return value


def journal(folder):
    """Whole lines of the journal: a torn one has no newline and vouches for nothing."""
    file = folder / "journal.jsonl"
    lines = file.read_text(errors="replace").split("\n")[:-1] if file.exists() else []
    return [json.loads(line) for line in lines]


def vouched(folder):
    """Frames the journal vouches for: {file: sha256}."""
    frames = {}
    for event in journal(folder):
        if event["event"] in ("dark", "shot"):
            frames.update({f["file"]: f["sha256"] for f in event["frames"]})
    return frames


def contents(folder, parts=("frames", "radiance", "result")):
    """What must be equal, as {name: hash}."""
    found = {}
    for part in parts:
        for file in sorted((folder / part).rglob("*")):
            if not file.is_file():
                continue
            data = file.read_bytes()
            if file.suffix == ".json":
                data = json.dumps(plain(json.loads(data)), sort_keys=True).encode()
            elif file.suffix == ".html" or file.name == "curve.png":
                continue  # show elapsed times and the session's name
            found[str(file.relative_to(folder))] = hashlib.sha256(data).hexdigest()
    entries = [plain(e) for e in journal(folder) if e["event"] in ("dark", "shot", "replanned")]
    for entry in entries:  # what an event is counted as depends on what else happened
        entry.pop("seq"), entry.pop("crc")
    found["journal"] = hashlib.sha256(json.dumps(entries, sort_keys=True).encode()).hexdigest()
    return found


class Matrix:
    def __init__(self, build, folder, reduce_every):
        self.build, self.folder, self.reduce_every = build, folder, reduce_every
        self.rig = write_rig(folder / "rig.toml")
        self.root = folder / "sessions"
        self.points = self.steps = self.reduced = self.identical = self.lost = self.twice = 0
        self.seconds = 0.0

    def service(self, kill_at=None, count=None, how="kill", more=(), log=None):
        env = {}
        if kill_at is not None:
            env = {"LD_PRELOAD": str(self.build / "libkill_points.so"), "LIGHTRIG_KILL_UNDER": str(self.root),
                   "LIGHTRIG_KILL_AT": str(kill_at), "LIGHTRIG_KILL_HOW": how}
            if count:
                env["LIGHTRIG_KILL_COUNT"] = str(count)
        return Service(self.build, self.rig, self.root, self.folder / "s.sock", "--simulate", *(more or ("--auto-arm",)), env=env,
                       log_level="info" if log else "error", log=log)

    def sessions(self):
        return sorted(f for f in self.root.glob("[0-9]*") if f.is_dir())

    @staticmethod
    def run_session(service, resume=None, until=(), refused=False):
        """Arms, starts or resumes, waits for the end or a state of `until`; the state it ended in."""
        service.wait_until_up()
        service.arm()
        path = f"/v1/sessions/{resume}/resume" if resume else "/v1/sessions"
        code, answer = service.ask("POST", path)
        if code not in (201, 202) and refused:
            return service.status()
        if code not in (201, 202):
            raise SystemExit(f"kill_matrix: {path} answered {code}: {answer}")
        return service.wait_for(lambda s: s["state"] in until or
                                not s["busy"] and s["state"] not in ("planning", "capturing", "reducing"))

    def whole(self):
        """The undisturbed session: what must come out, and how many steps it took."""
        count = self.folder / "count"
        service = self.service(kill_at=0, count=count)
        begun = time.monotonic()
        state = self.run_session(service)
        self.seconds = time.monotonic() - begun
        assert state["state"] == "done", state
        assert service.stop() == 0
        session, = self.sessions()
        self.expected, self.expected_frames = contents(session), contents(session, ("frames",))
        steps, *self.story = count.read_text().splitlines()
        shutil.copytree(session, self.folder / "expected")
        return int(steps)

    def strike(self, at=None, after=None, session=None):
        """A service that begins a session, or resumes one, killed at a step, or after so many seconds; whether it died of it."""
        service = self.service(kill_at=at)
        died = False
        try:
            if after is None:
                self.finish(service, session, ())
            else:
                service.wait_until_up()
                end = time.monotonic() + after
                service.arm()
                service.ask("POST", f"/v1/sessions/{session}/resume" if session else "/v1/sessions")
                # A machine that has grown quicker has ended the session by then: killed in peace is a moment too.
                while time.monotonic() < end and service.status()["state"] != "done":
                    time.sleep(min(0.002, max(0, end - time.monotonic())))
        except Gone:
            died = True
        service.process.kill()
        service.process.wait()
        return died

    def kill(self, at=None, after=None, again=None):
        """One point: killed at a step, or after so many seconds, and, with `again`, once more that long into what resumes it;
        restarted, resumed, compared."""
        shutil.rmtree(self.root, ignore_errors=True)
        if not self.strike(at, after) and at is not None:
            return None  # threads took another order and there were fewer steps
        left = self.sessions()
        before = vouched(left[0]) if left else {}
        if again:
            self.strike(**again, session=left[0].name if left else None)
            self.twice += 1
            left = self.sessions()
            before = {**before, **(vouched(left[0]) if left else {})}
        ended = left and any(e["event"] == "ended" for e in journal(left[0]))
        whole = ended or self.points % self.reduce_every == 0
        service = self.service()
        state = self.finish(service, left[0].name if left else None, () if whole else ("reducing",))
        if whole:
            service.stop()
        else:
            service.process.kill()
            service.process.wait()
        session, = self.sessions()
        lost = sum(1 for f, h in before.items()
                   if not (session / f).exists() or hashlib.sha256((session / f).read_bytes()).hexdigest() != h)
        got = contents(session) if whole else contents(session, ("frames",))
        expected = self.expected if whole else self.expected_frames
        same = state == ("done" if whole else "reducing") and got == expected
        self.reduced += whole
        self.points, self.identical, self.lost = self.points + 1, self.identical + same, self.lost + lost
        self.steps += at is not None and not again
        if not same or lost:
            where = f"step {at} ({self.story[at - 1]})" if at else f"{after:.3f} s"
            where += f", then {again}" if again else ""
            differ = [f for f in sorted({*got, *expected}) if got.get(f) != expected.get(f)]
            print(f"killed at {where}: ended {state}, {lost} frames lost, differ: {' '.join(differ[:6])}", flush=True)
        return same

    def finish(self, service, session, until):
        """What an operator does: arm, resume what was begun, or begin anew where nothing was."""
        if session is None:
            return self.run_session(service, until=until)["state"]
        service.wait_until_up()
        service.arm()
        if service.ask("GET", f"/v1/sessions/{session}")[1].get("sealed"):
            return "done"
        return self.run_session(service, session, until)["state"]
