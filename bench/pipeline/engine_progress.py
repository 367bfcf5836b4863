"""The time left that `--progress json` told, against what it was: at a tenth, a quarter, a half and three quarters of the run.

    python3 bench/pipeline/engine_progress.py RILIEVO IMAGES [ORIENT OPTIONS]
"""
import json
import subprocess
import sys
import tempfile

SHARES = (0.1, 0.25, 0.5, 0.75)


def errors(lines):
    """{share of the run: (time left told, true time left, relative error)} of the lines of a whole run."""
    events = [json.loads(line) for line in lines if line.startswith("{")]
    events = [event for event in events if "total_eta_s" in event]
    end_s = max(event["elapsed_s"] for event in events)
    found = {}
    for share in SHARES:
        event = next((e for e in events if e["elapsed_s"] >= share * end_s and e["total_eta_s"] is not None), None)
        if event is None:
            continue
        left_s = end_s - event["elapsed_s"]
        found[share] = (event["total_eta_s"], left_s, abs(event["total_eta_s"] - left_s) / left_s if left_s > 0 else 0.0)
    return end_s, found


def measure(rilievo, images, *options):
    with tempfile.TemporaryDirectory() as workspace:
        command = [rilievo, "orient", images, "--workspace", workspace + "/w", "--progress", "json", *options]
        done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    if done.returncode != 0:
        raise RuntimeError(done.stderr.splitlines()[-1])
    return errors(done.stderr.splitlines())


if __name__ == "__main__":
    whole_s, told = measure(*sys.argv[1:])
    print(f"run {whole_s:.1f} s")
    for at, (eta_s, true_s, error) in told.items():
        print(f"at {100 * at:.0f} %: {eta_s:.1f} s left told, {true_s:.1f} s were left, error {100 * error:.0f} %")
