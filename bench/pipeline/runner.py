"""Runs the bench of one issue, prints name, value, bar and verdict, and writes the JSON. Standard library only."""
import argparse
import importlib
import json
import os
import pathlib
import platform
import subprocess
import sys
import traceback

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
NAMES = ["pipeline", "orient", "features", "table1", "matching", "engine", "adjustment", "mapping", "refinement", "dense", "report"]


class Figures:
    """Collects one entry for every row of an issue's table."""

    def __init__(self, options=None):
        self.options, self.entries = options, []

    def add(self, name, value, unit, bar, holds):
        self._append({"name": name, "value": value, "unit": unit, "bar": bar, "holds": bool(holds), "skipped": None})

    def at_most(self, name, value, unit, limit):
        self.add(name, value, unit, f"<= {limit:g}", value is not None and value <= limit)

    def at_least(self, name, value, unit, limit):
        self.add(name, value, unit, f">= {limit:g}", value is not None and value >= limit)

    def skip(self, name, unit, bar, reason):
        self._append({"name": name, "value": None, "unit": unit, "bar": bar, "holds": False, "skipped": reason})

    def fail(self, name, unit, bar, reason):
        """A figure that could not be measured though it should have been: it falls short, and says why."""
        self._append({"name": name, "value": None, "unit": unit, "bar": bar, "holds": False, "skipped": None, "reason": reason})

    def measure(self, rows, part):
        """Runs `part`. Whatever happens in it, each of `rows` (name, unit, bar) has an entry afterwards, and the other parts go on."""
        reason = "not measured"
        try:
            part()
        except Exception as error:  # noqa: BLE001 - a bench reports what is wrong and goes on
            traceback.print_exc()
            reason = " ".join(f"{type(error).__name__}: {error}".split())
        measured = {entry["name"] for entry in self.entries}
        for name, unit, bar in rows:
            if name not in measured:
                self.fail(name, unit, bar, reason)

    def _append(self, entry):
        self.entries.append(entry)
        value = "-" if entry["value"] is None else f"{entry['value']:.6g}" if isinstance(entry["value"], float) else str(entry["value"])
        verdict = f"skipped: {entry['skipped']}" if entry["skipped"] else "holds" if entry["holds"] else "FALLS SHORT"
        if entry.get("reason"):
            verdict += f": {entry['reason']}"
        print(f"{entry['name']:<58} {value:>12} {entry['unit']:<6} {entry['bar']:<12} {verdict}", flush=True)


def machine():
    model = next((line.split(":", 1)[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")), platform.processor())
    flags = next((line for line in open("/proc/cpuinfo") if line.startswith("flags")), "")
    return {"cpu": model, "cores": len(os.sched_getaffinity(0)), "avx512": "avx512f" in flags, "avx512_vnni": "avx512_vnni" in flags,
            "memory_bytes": os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")}


def commit():
    done = subprocess.run(["git", "-C", str(ROOT), "describe", "--always", "--dirty", "--abbrev=12"], capture_output=True, text=True)
    return done.stdout.strip() or "unknown"


def build():
    """The release program and the micro-benchmarks, so that a bench never measures something stale."""
    for command in (["cmake", "--preset", "bench"], ["cmake", "--build", "--preset", "bench"]):
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
        if done.returncode != 0:
            sys.exit(f"bench: {' '.join(command)} failed:\n{done.stdout[-3000:]}{done.stderr[-3000:]}")
    return ROOT / "build" / "bench" / "bin"


def main(arguments):
    if arguments[:1] == ["compare"]:
        import compare

        return compare.main(arguments[1:])
    parser = argparse.ArgumentParser(prog="scripts/bench", epilog="scripts/bench compare A.json B.json: ratios of two JSON files")
    parser.add_argument("name", choices=NAMES)
    parser.add_argument("--json", metavar="FILE")
    parser.add_argument("--full", action="store_true", help="also the figures that take hours")
    parser.add_argument("--with-colmap", action="store_true", help="pipeline: COLMAP beside, on the same images")
    options = parser.parse_args(arguments)
    try:
        module = importlib.import_module(f"bench_{options.name}")
    except ModuleNotFoundError as missing:
        if missing.name != f"bench_{options.name}":
            raise
        print(f"bench: '{options.name}' has no figures yet", file=sys.stderr)
        return 2
    figures = Figures(options)
    data = pathlib.Path(os.environ.get("RILIEVO_DATA", ROOT.parent / "shared" / "data")).resolve()
    more = module.measure(figures, build(), data, options.full) or {}
    if options.json:
        pathlib.Path(options.json).write_text(
            json.dumps({"figures": figures.entries, "machine": machine(), "commit": commit(), **more}, indent=1) + "\n")
    short = sum(1 for entry in figures.entries if not entry["holds"])
    print(f"{len(figures.entries) - short} of {len(figures.entries)} figures hold")
    return 1 if short else 0
