"""Runs the program while one of its writing system calls fails, then again: what tests and benches ask of that. Standard library only."""
import dataclasses
import hashlib
import os
import pathlib
import shutil
import signal
import subprocess

# What may happen to a call of each name (tests/support/fault_shim.cc).
EVERYWHERE = ("EIO", "ENOSPC", "kill")
KINDS = {"write": EVERYWHERE + ("full", "short", "partial", "EINTR"), "open": EVERYWHERE + ("full", "EINTR"), "mkdir": EVERYWHERE + ("full",),
         "fsync": EVERYWHERE + ("EINTR",), "open-folder": EVERYWHERE + ("EINTR",)}


@dataclasses.dataclass
class Call:
    number: int  # from 1, in the order of the run
    name: str
    path: str


def digests(folder):
    """{relative name: SHA-256} of every file below `folder`."""
    folder = pathlib.Path(folder)
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(folder.rglob("*")) if p.is_file()}


def artifacts(workspace):
    """{relative name: (inode, time)} of finished artifacts: one that was made again is another file. Checkpoints come and go."""
    root = pathlib.Path(workspace) / "artifacts"
    found = {str(p.relative_to(root)): (p.stat().st_ino, p.stat().st_mtime_ns) for p in sorted(root.rglob("*.art"))}
    return {name: state for name, state in found.items() if not name.startswith("checkpoints/")}


class FaultTrials:
    """One command on one block, with one thread: then its calls have an order. `scratch` holds its workspaces."""

    def __init__(self, program, shim, images, calibration, scratch, options=()):
        self.program, self.shim, self.scratch = str(program), str(shim), pathlib.Path(scratch)
        self.inputs = [str(images), "--calibration", str(calibration), "--progress", "quiet", "--threads", "1", *options]
        workspace = self.scratch / "reference"
        log = self.scratch / "reference.log"
        done = self.orient(workspace, {"RILIEVO_FAULT_CALL": "0", "RILIEVO_FAULT_LOG": str(log)})
        if done.returncode != 0:
            raise RuntimeError(f"the run that is left alone ends with {done.returncode}: {done.stderr.strip()}")
        lines = [line.split(" ", 1) for line in log.read_text().splitlines()]
        self.calls = [Call(i + 1, name, path) for i, (name, path) in enumerate(lines)]
        self.artifacts = digests(workspace / "artifacts")
        self.files = set(digests(workspace))
        self.export = self.exported(workspace)
        if len(self.artifacts) < 5 or len(self.export) < 3:
            raise RuntimeError("the run that is left alone leaves next to nothing")

    def orient(self, workspace, environment=None):
        variables = dict(os.environ)
        if environment:
            variables.update(environment, LD_PRELOAD=self.shim, RILIEVO_FAULT_UNDER=str(workspace.resolve()))
            variables["ASAN_OPTIONS"] = variables.get("ASAN_OPTIONS", "") + ":verify_asan_link_order=0"
        return subprocess.run([self.program, "orient", *self.inputs, "--workspace", str(workspace)], capture_output=True, text=True, env=variables, timeout=600)

    def exported(self, workspace):
        output = workspace.parent / f"{workspace.name}-export"
        done = subprocess.run([self.program, "export", str(workspace), "--format", "colmap-text", "--output", str(output)], capture_output=True, text=True, timeout=600)
        return digests(output) if done.returncode == 0 else f"no export: {done.stderr.strip()}"

    def trials(self):
        """Every (call, kind) there is."""
        return [(call, kind) for call in self.calls for kind in KINDS.get(call.name, EVERYWHERE)]

    def problems(self, call, kind):
        """What is wrong after this call of a fresh run suffered this and the command was given again; empty when all is well."""
        workspace = self.scratch / f"call-{call.number}-{kind}"
        log = self.scratch / f"{workspace.name}.log"
        faulted = self.orient(workspace, {"RILIEVO_FAULT_CALL": str(call.number), "RILIEVO_FAULT_KIND": kind, "RILIEVO_FAULT_LOG": str(log)})
        found = [] if any(line.startswith("!") for line in log.read_text().splitlines()) else ["the fault was not met"]
        found += self.ending(faulted, kind)
        found += [f"damaged under its final name: {name}" for name, digest in digests(workspace / "artifacts").items()
                  if name.endswith(".art") and self.artifacts.get(name, digest) != digest]
        before = artifacts(workspace)
        again = self.orient(workspace)
        if again.returncode != 0:
            return found + [f"the rerun ends with {again.returncode}: {again.stderr.strip()}"]
        after = artifacts(workspace)
        found += [f"made again: {name}" for name, state in before.items() if after.get(name) != state]
        if digests(workspace / "artifacts") != self.artifacts:
            found.append("other artifacts than those of a run left alone")
        if self.exported(workspace) != self.export:
            found.append("another export")
        # The trace of a run that was cut short is lost; one that computes nothing keeps none.
        if odd := (set(digests(workspace)) ^ self.files) - {"trace.json"}:
            found.append(f"left over or missing: {odd}")
        return found

    @staticmethod
    def ending(done, kind):
        """A run that met the fault succeeds, or says so in one line and ends with 1."""
        if kind == "kill":
            return [] if done.returncode == -signal.SIGKILL else [f"killed, and ended with {done.returncode}"]
        lines = [line for line in done.stderr.splitlines() if line.strip() and "WARNING" not in line]
        if done.returncode == 0:
            return [f"success that complains: {done.stderr.strip()}"] if lines else []
        unclear = len(lines) != 1 or not lines[0].startswith("rilievo: ") or "unexpected error" in lines[0] or "internal error" in lines[0]
        return [f"ended with {done.returncode}: {done.stderr.strip()}"] if done.returncode != 1 or unclear else []

    def clean(self, call, kind):
        """Removes what the trial has left."""
        name = f"call-{call.number}-{kind}"
        for path in (self.scratch / name, self.scratch / f"{name}-export"):
            shutil.rmtree(path, ignore_errors=True)
        (self.scratch / f"{name}.log").unlink(missing_ok=True)
