"""The figures of "The four promises at scale"."""
import hashlib
import pathlib
import random
import shutil
import signal
import sys

import engine_bounded
import engine_full
from blocks import Runs
from program import artifacts_of

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent.parent / "tests" / "support"))
from faults import FaultTrials  # noqa: E402

MATRIX = "60 x 6 Mpx"
MATRIX_ROWS = [(f"{MATRIX}: hashes of all exports", "", "1 of 14 runs")]


def hash_of(files):
    digest = hashlib.sha256()
    for name in sorted(files):
        digest.update(name.encode() + b"\0" + hashlib.sha256(files[name]).digest())
    return digest.hexdigest()


def sixty(runs):
    return runs.block("ring-60x6", "--surface", "statue", "--network", "ring", "--images", "60", "--width-px", "3000", "--height-px", "2000", "--distance-m", "3")


def shuffled_copy(runs, block):
    """The photographs again, written in another order and at other times."""
    folder = runs.scratch / "shuffled"
    folder.mkdir()
    paths = sorted(block.images.iterdir())
    random.Random(3).shuffle(paths)
    for path in paths:
        shutil.copyfile(path, folder / path.name)
    return folder


def interrupted(runs, name, block, wall_s, options):
    """A run killed at three random moments, then left alone."""
    draw = random.Random(5)
    for _ in range(3):
        runs.orient(name, block, *options, kill_after_s=draw.uniform(0.1, 0.5) * wall_s)
    return runs.must_orient(name, block, *options)


def matrix(figures, runs):
    block = sixty(runs)
    base = ("--network", "guided", "--memory", "4GiB")
    workspace, reference = runs.must_orient("matrix-reference", block, *base, "--threads", "2")
    exports = {"threads 2": runs.export(workspace)}
    runs.drop(workspace)
    smallest_mib = engine_bounded.smallest_memory_mib(runs, block, "--network", "guided")
    cases = {f"threads {n}": base + ("--threads", str(n)) for n in (1, 4, 8)}
    cases.update({"serial": base + ("--serial",), "memory 2GiB": ("--network", "guided", "--memory", "2GiB"), "memory 1GiB": ("--network", "guided", "--memory", "1GiB"),
                  f"memory {smallest_mib}MiB": ("--network", "guided", "--memory", f"{smallest_mib}MiB")})
    cases.update({f"strips of {n} px": base + ("--strip-width", str(n)) for n in (128, 777, 4000)})
    for name, options in cases.items():
        workspace, done = runs.must_orient("matrix-case", block, *options)
        exports[name] = runs.export(workspace)
        runs.drop(workspace)
        print(f"  {name}: {done.wall_s:.0f} s wall, {hash_of(exports[name])[:12]}", flush=True)
    workspace, _ = runs.must_orient("matrix-shuffled", block, *base, images=shuffled_copy(runs, block))
    exports["shuffled"] = runs.export(workspace)
    runs.drop(workspace)
    workspace, _ = interrupted(runs, "matrix-interrupted", block, reference.wall_s, base)
    exports["interrupted"] = runs.export(workspace)
    workspace, _ = runs.must_orient("matrix-interrupted", block, *base)
    exports["nothing to do"] = runs.export(workspace)
    runs.drop(workspace)
    hashes = {name: hash_of(files) for name, files in exports.items()}
    for name, value in hashes.items():
        if value != hashes["threads 2"]:
            print(f"  differs: {name}")
    complete = all(len(files) >= 6 for files in exports.values())
    figures.add(MATRIX_ROWS[0][0], len(set(hashes.values())), "", MATRIX_ROWS[0][2], len(set(hashes.values())) == 1 and complete and len(hashes) == 14)


KILLS = 100
KILL_ROWS = [(f"kill -9 x {KILLS}: runs that were interrupted", "runs", f">= {KILLS * 3 // 4}"), (f"kill -9 x {KILLS}: exports that differ", "runs", "<= 0"),
             (f"kill -9 x {KILLS}: finished artifacts recomputed", "files", "<= 0"), ("block of the kills: time of a run", "s", "<= 4")]


def small(runs):
    return runs.block("arc-6", "--images", "6", "--width-px", "900", "--height-px", "600")


def killed(figures, runs):
    block = small(runs)
    runs.must_orient("kill-warm-up", block)
    workspace, alone = runs.must_orient("kill-reference", block)
    reference = runs.export(workspace)
    if len(reference) < 6:
        raise RuntimeError("the run that is not killed gives no export")
    draw = random.Random(20105)
    count = differ = recomputed = 0
    for trial in range(KILLS):
        workspace, first = runs.orient("killed", block, kill_after_s=draw.uniform(0.01, 0.98) * alone.wall_s)
        count += first.code == -signal.SIGKILL
        before = artifacts_of(workspace)
        _, again = runs.orient("killed", block)
        after = artifacts_of(workspace)
        recomputed += sum(1 for name, state in before.items() if after.get(name) != state)
        differ += again.code != 0 or runs.export(workspace) != reference
        runs.drop(workspace)
    figures.at_least(KILL_ROWS[0][0], count, "runs", KILLS * 3 // 4)
    figures.at_most(KILL_ROWS[1][0], differ, "runs", 0)
    figures.at_most(KILL_ROWS[2][0], recomputed, "files", 0)
    figures.at_most(KILL_ROWS[3][0], alone.wall_s, "s", 4)


FAULT_ROWS = [("faults: calls of the publish path, each in every way", "", ">= 300"), ("faults: wrong results, crashes, unclear ends", "", "<= 0")]


def faults(figures, runs):
    """Every call of the publish path of a run, failing once in every way (tests/support/fault_shim.cc)."""
    block = runs.block("arc-4", "--images", "4", "--width-px", "420", "--height-px", "320")
    trials = FaultTrials(runs.rilievo, runs.binaries / "rilievo_fault_shim.so", block.images, block.calibration, runs.scratch, ("--max-features", "1500"))
    bad = 0
    every = trials.trials()
    for call, kind in every:
        problems = trials.problems(call, kind)
        bad += bool(problems)
        if problems:
            print(f"  call {call.number} ({call.name} {call.path}), {kind}: {'; '.join(problems)}", flush=True)
        trials.clean(call, kind)
    figures.at_least(FAULT_ROWS[0][0], len(every), "", 300)
    figures.at_most(FAULT_ROWS[1][0], bad, "", 0)


OVERHEAD_ROWS = [(f"{MATRIX}: scheduling overhead + artifact I/O", "%", "<= 5")]


def overhead(figures, runs):
    """An upper bound, in shares of the wall time of two threads: system calls on files of the workspace (preloaded clock), all time in which
    one of two workers had no task before the orientation began, and what lies before the first and after the last task."""
    block = sixty(runs)
    trace, times = runs.scratch / "overhead.json", runs.scratch / "overhead-times"
    workspace = (runs.scratch / "overhead").resolve()
    env = engine_bounded.with_shim(runs, RILIEVO_FAULT_UNDER=str(workspace), RILIEVO_FAULT_TIMES=str(times))
    _, done = runs.must_orient("overhead", block, "--network", "guided", "--memory", "4GiB", "--threads", "2", "--trace", trace, env=env)
    runs.drop(workspace)
    idle_s, outside_s, _ = engine_full.shares(trace, done.wall_s)
    io_s = float(times.read_text())
    print(f"  wall {done.wall_s:.1f} s; files {io_s:.2f} s of {2 * done.wall_s:.1f} s; workers idle before the orientation {idle_s:.2f} s; outside of tasks {outside_s:.2f} s")
    figures.at_most(OVERHEAD_ROWS[0][0], 100 * (io_s + idle_s + 2 * outside_s) / (2 * done.wall_s), "%", 5)


def measure(figures, binaries, data, full):
    del data  # simulated blocks alone
    runs = Runs(binaries)
    parts = [(faults, FAULT_ROWS), (killed, KILL_ROWS), (engine_bounded.bounded, engine_bounded.ROWS), (overhead, OVERHEAD_ROWS), (matrix, MATRIX_ROWS)]
    if full:
        parts.append((engine_full.three_hundred, engine_full.ROWS))
    try:
        for part, rows in parts:
            figures.measure(rows, lambda: part(figures, runs))
    finally:
        runs.close()
    if not full:
        for name, unit, bar in engine_full.ROWS:
            figures.skip(name, unit, bar, "takes hours: --full")
