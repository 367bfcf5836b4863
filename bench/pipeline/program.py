"""Runs a program as a user does and measures it: wall and CPU seconds, peak resident memory. Standard library only."""
import dataclasses
import os
import pathlib
import resource
import signal
import subprocess
import time


@dataclasses.dataclass
class Run:
    code: int
    out: str
    err: str
    wall_s: float
    cpu_s: float
    peak_bytes: int  # VmHWM of the process, as the kernel reports it at its end


def run(command, kill_after_s=None, env=None, cwd=None, data_limit_bytes=None):
    """Runs to the end, or until SIGKILL after `kill_after_s`; output is collected through files, so that wait4 can report.
    `data_limit_bytes`: most private memory the system gives it (prlimit --data)."""
    import tempfile

    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        start = time.monotonic()
        process = subprocess.Popen([str(part) for part in command], stdout=out, stderr=err, env=env, cwd=cwd,
                                   preexec_fn=data_limit_bytes and (lambda: resource.setrlimit(resource.RLIMIT_DATA, (data_limit_bytes, data_limit_bytes))))
        if kill_after_s is not None:
            while time.monotonic() - start < kill_after_s and process.poll() is None:
                time.sleep(0.005)
            if process.poll() is None:
                process.send_signal(signal.SIGKILL)
        if process.returncode is None:
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            cpu_s, peak = usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024
        else:
            cpu_s, peak = float("nan"), 0
        wall_s = time.monotonic() - start
        out.seek(0)
        err.seek(0)
        return Run(process.returncode, out.read().decode(errors="replace"), err.read().decode(errors="replace"), wall_s, cpu_s, peak)


def files_of(folder):
    """{relative name: bytes} of every file below `folder`."""
    folder = pathlib.Path(folder)
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def artifacts_of(workspace):
    """{relative name: (inode, modification time)} of finished artifacts: a recomputed one is a new file. Checkpoints of a step come and go."""
    root = pathlib.Path(workspace) / "artifacts"
    found = {str(path.relative_to(root)): (path.stat().st_ino, path.stat().st_mtime_ns) for path in sorted(root.rglob("*.art"))}
    return {name: state for name, state in found.items() if not name.startswith("checkpoints/")}
