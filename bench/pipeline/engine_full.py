"""The block of 300 images of 24 Mpx: hours. What a trace says about two cores."""
import json

BLOCK = "300 x 24 Mpx"
ROWS = [(f"{BLOCK}, --memory 4GiB: images oriented", "", ">= 300"), (f"{BLOCK}, --memory 4GiB: two cores busy until the bundle", "%", ">= 90"),
        (f"{BLOCK}, --memory 4GiB: peak resident memory", "GiB", "<= 4"), (f"{BLOCK}, --memory 4GiB: time", "min", "reported"),
        (f"{BLOCK}, --memory 1GiB: images oriented", "", ">= 300"), (f"{BLOCK}, --memory 1GiB: time / that at 4GiB", "x", "<= 1.5"),
        (f"{BLOCK}, --memory 1GiB: peak resident memory", "GiB", "<= 1")]


def spans(trace):
    return [event for event in json.loads(trace.read_text())["traceEvents"] if event["ph"] == "X"]


def shares(trace, wall_s, threads=2):
    """(seconds that workers had no task before the orientation began, wall seconds outside of all tasks, busy seconds by stage)."""
    events = spans(trace)
    first = min(event["ts"] for event in events) / 1e6
    last = max(event["ts"] + event["dur"] for event in events) / 1e6
    bundle = min((event["ts"] / 1e6 for event in events if event["cat"] == "orientation"), default=last)
    stages = {}
    for event in events:
        stages[event["cat"]] = stages.get(event["cat"], 0) + event["dur"] / 1e6
    before = sum(event["dur"] / 1e6 for event in events if event["cat"] != "orientation" and event["ts"] / 1e6 < bundle)
    return threads * (bundle - first) - before, wall_s - (last - first), stages


def busy_percent(trace, threads=2):
    """Of all workers, from the first task to the start of the orientation."""
    events = spans(trace)
    first = min(event["ts"] for event in events) / 1e6
    bundle = min(event["ts"] / 1e6 for event in events if event["cat"] == "orientation")
    before = sum(event["dur"] / 1e6 for event in events if event["cat"] != "orientation" and event["ts"] / 1e6 < bundle)
    return 100 * before / (threads * (bundle - first))


def oriented(runs, workspace):
    report = runs.report(workspace)
    return len(report["models"][0]["images"]) if report and report["models"] else 0


def three_hundred(figures, runs):
    block = runs.block("ring-300x24", "--surface", "statue", "--network", "ring", "--images", "300", "--width-px", "6000", "--height-px", "4000", "--distance-m", "3")
    times = {}
    for memory in ("4GiB", "1GiB"):
        trace = runs.scratch / f"full-{memory}.json"
        workspace, done = runs.must_orient(f"full-{memory}", block, "--network", "guided", "--threads", "2", "--memory", memory, "--trace", trace)
        times[memory] = done.wall_s
        idle_s, outside_s, stages = shares(trace, done.wall_s)
        print(f"  --memory {memory}: {done.wall_s / 60:.1f} min wall, {done.cpu_s / 60:.1f} min CPU; idle {idle_s:.0f} s, outside of tasks {outside_s:.0f} s; busy by stage: "
              + ", ".join(f"{stage} {seconds:.0f} s" for stage, seconds in sorted(stages.items(), key=lambda item: -item[1])), flush=True)
        figures.at_least(f"{BLOCK}, --memory {memory}: images oriented", oriented(runs, workspace), "", 300)
        figures.at_most(f"{BLOCK}, --memory {memory}: peak resident memory", done.peak_bytes / 2**30, "GiB", int(memory[0]))
        if memory == "4GiB":
            figures.at_least(ROWS[1][0], busy_percent(trace), "%", 90)
            figures.add(ROWS[3][0], done.wall_s / 60, "min", "reported", True)
        runs.drop(workspace)
    figures.at_most(ROWS[5][0], times["1GiB"] / times["4GiB"], "x", 1.5)
