"""One run on one block, as numbers: time, memory, accuracy, and counters of the work that are exact. Standard library only."""
import json
import os
import statistics

from program import run

# name: options of `simulate`; the smallest runs in CI (tests/pipeline/baseline_test.py).
SIMULATED = {
    "simulated-6": ("--images", "6", "--width-px", "900", "--height-px", "600"),
    "simulated-12": ("--images", "12", "--width-px", "4000", "--height-px", "3000"),
    "simulated-60": ("--surface", "statue", "--network", "ring", "--images", "60", "--width-px", "3000", "--height-px", "2000", "--distance-m", "3"),
    "simulated-300": ("--surface", "statue", "--network", "ring", "--images", "300", "--width-px", "6000", "--height-px", "4000", "--distance-m", "3"),
}
# folder of the data: (images, calibration).
REAL = {
    "strecha/fountain-P11": ("images", "images/K.txt"), "strecha/entry-P10": ("images", "images/K.txt"), "saharov32": (".", "cameras.txt"),
    "temple47": (".", "K.txt"), "cyprus10": ("images", "cameras.txt"),
}


def counters_of(trace):
    """{stage: {tasks, read_bytes, written_bytes}}: exact, the same for any number of threads."""
    stages = {}
    for event in json.loads(trace.read_text())["traceEvents"]:
        if event["ph"] != "X":
            continue
        stage = stages.setdefault(event["cat"], {"tasks": 0, "read_bytes": 0, "written_bytes": 0})
        stage["tasks"] += 1
        stage["read_bytes"] += event["args"]["read_bytes"]
        stage["written_bytes"] += event["args"]["written_bytes"]
    return dict(sorted(stages.items()))


def accuracy_of(report):
    """What the report says, and beside exact truth where there is one."""
    models = report["models"]
    accuracy = {"oriented": len(models[0]["images"]) if models else 0, "components": len(models), "points": sum(m["points"] for m in models), "rays": sum(m["rays"] for m in models),
                "sigma0_px": models[0]["sigma0_px"] if models else None}
    truth = report.get("truth")
    if truth:
        accuracy["mean_centre_error_relative"] = truth["mean_centre_error_relative"]
    return accuracy


def measure_block(program, images, calibration, workspace, trace, scene=None, options=(), env=None):
    """{images, pairs, wall_s, cpu_s, peak_bytes, counters, accuracy} of a run in a new workspace. Throws RuntimeError when it fails."""
    done = run([program, "orient", images, "--calibration", calibration, "--workspace", workspace, "--trace", trace, "--progress", "quiet", *options], env=env)
    if done.code != 0:
        raise RuntimeError(f"exit code {done.code}: {done.err.strip()}")
    told = run([program, "report", workspace, "--json", *(("--truth", scene) if scene else ())])
    if told.code != 0:
        raise RuntimeError(f"report: exit code {told.code}: {told.err.strip()}")
    report = json.loads(told.out)
    return {"images": report["images"] if isinstance(report["images"], int) else len(report["images"]), "pairs": len(report["pair_list"]), "wall_s": done.wall_s, "cpu_s": done.cpu_s,
            "peak_bytes": done.peak_bytes, "counters": counters_of(trace), "accuracy": accuracy_of(report)}


def reference_loop_s(program):
    """CPU seconds of a fixed loop of multiply-adds and memory traffic (bench/pipeline/reference_loop.cc), median of 5."""
    return statistics.median(float(run([program], env=dict(os.environ)).out) for _ in range(5))
