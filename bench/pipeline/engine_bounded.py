"""Memory: peaks under limits, limits of the system, and refusals that name what works."""
import os
import re

from blocks import last_line

LIMITS = ("2GiB", "1GiB", "smallest")
ROWS = [row for limit in LIMITS for row in ((f"12 x 12 Mpx, --memory {limit}: peak / limit", "x", "<= 1"),
                                            (f"12 x 12 Mpx, --memory {limit}: runs with 1.15 x as data limit", "", "yes"))]
ROWS += [("too small a limit: refused, and the limit it names works", "", "yes")]


def with_shim(runs, **variables):
    return dict(os.environ, LD_PRELOAD=str(runs.binaries / "rilievo_fault_shim.so"), **variables)


def bytes_of(limit):
    number, unit = re.fullmatch(r"(\d+)([MG]iB)", limit).groups()
    return int(number) << (20 if unit == "MiB" else 30)


def smallest_memory_mib(runs, block, *options):
    """The limit that the refusal of too small a one names, MiB."""
    workspace, refused = runs.orient("refused", block, *options, "--memory", "193MiB")
    named = re.search(r"use --memory (\d+)MiB", refused.err)
    if refused.code != 1 or not named or workspace.exists():
        raise RuntimeError(f"not refused as it should be: exit code {refused.code}: {last_line(refused.err)}")
    return int(named[1])


def bounded(figures, runs):
    block = runs.block("arc-12x12", "--images", "12", "--width-px", "4000", "--height-px", "3000")
    smallest = f"{smallest_memory_mib(runs, block)}MiB"
    works = False
    for limit in LIMITS:
        memory = smallest if limit == "smallest" else limit
        workspace, done = runs.orient("bounded", block, "--memory", memory)
        print(f"  --memory {memory}: exit code {done.code}, peak {done.peak_bytes / 2**20:.0f} MiB, {done.wall_s:.0f} s; {last_line(done.err)}", flush=True)
        works |= limit == "smallest" and done.code == 0
        figures.at_most(f"12 x 12 Mpx, --memory {limit}: peak / limit", done.peak_bytes / bytes_of(memory) if done.code == 0 else None, "x", 1)
        runs.drop(workspace)
        workspace, done = runs.orient("bounded", block, "--memory", memory, data_limit_bytes=int(1.15 * bytes_of(memory)))
        if done.code != 0:
            print(f"  under a data limit: {last_line(done.err)}")
        figures.add(f"12 x 12 Mpx, --memory {limit}: runs with 1.15 x as data limit", int(done.code == 0), "", "yes", done.code == 0)
        runs.drop(workspace)
    figures.add(ROWS[-1][0], smallest, "", "yes", works)
