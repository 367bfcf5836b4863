"""Verification of a pair beside cv::findEssentialMat, and its accuracy on simulated pairs."""
import json
import os

from program import run

PAIRS = "24"
PEERS = ("opencv_ransac", "opencv_usac_magsac")
CONFIDENCES = (0.999, 0.9999)
RECOVERED, WRONG = 0.95, 0.01
KERNELS = ("scalar", "avx2", "avx512")


def speed_row(outliers, confidence):
    return (f"verification, {outliers:.0%} outliers, confidence {confidence}: OpenCV CPU / ours", "x", ">= 5")


SPEED_ROWS = {(outliers, confidence): speed_row(outliers, confidence) for outliers in (0.6, 0.7) for confidence in CONFIDENCES}
ACCURACY_ROWS = [("verification: right matches recovered, worst case", "%", ">= 95"), ("verification: wrong matches, worst case", "%", "<= 1")]
IDENTITY_ROWS = [("verification: answers that differ between kernels", "pairs", "<= 0")]
ROWS = [*SPEED_ROWS.values(), *ACCURACY_ROWS, *IDENTITY_ROWS]


def last_line(text):
    return text.strip().splitlines()[-1] if text.strip() else "no message"


def evaluate(bench, *arguments, kernels=None):
    environment = {k: v for k, v in os.environ.items() if k != "RILIEVO_KERNELS"}
    if kernels:
        environment["RILIEVO_KERNELS"] = kernels
    done = run([bench.binaries / "verification_eval", *arguments], env=environment)
    if done.code != 0:
        raise RuntimeError(f"verification_eval ended with {done.code}: {last_line(done.err)}")
    return json.loads(done.out)


def fulfils(entry):
    return entry["recovered"] >= RECOVERED and entry["wrong"] <= WRONG


def describe(case):
    return f"{'planar' if case['planar'] else 'general'}, {case['outlier_share']:.0%} outliers, {case['noise_px']} px, confidence {case['confidence']}"


def print_case(case):
    print(f"  {describe(case)}:")
    for name, entry in case.items():
        if isinstance(entry, dict):
            print(f"    {name:<32} {entry['cpu_ms']:8.2f} ms, recovered {100 * entry['recovered']:6.2f} %, wrong {100 * entry['wrong']:5.2f} %, "
                  f"rotation {entry['rotation_deg']:.4f}, translation {entry['translation_deg']:.4f} deg")


def speed(bench, cases):
    """The peer is the faster one whatever its accuracy: a bar that the better one of those that are accurate enough can only ease. Scenes of the
    worst ratio count."""
    for (outliers, confidence), (name, unit, _) in SPEED_ROWS.items():
        of_row = [case for case in cases if case["outlier_share"] == outliers and case["confidence"] == confidence]
        ratios = [min(case[peer]["cpu_ms"] for peer in PEERS) / case["verification"]["cpu_ms"] for case in of_row]
        accurate = [min((case[peer]["cpu_ms"] for peer in PEERS if fulfils(case[peer])), default=None) for case in of_row]
        print(f"  {outliers:.0%}, {confidence}: E alone {min(min(c[p]['cpu_ms'] for p in PEERS) / c['essential']['cpu_ms'] for c in of_row):.1f} x; beside the faster accurate one: "
              + ", ".join("none is" if a is None else f"{a / c['verification']['cpu_ms']:.1f} x" for a, c in zip(accurate, of_row)))
        bench.figures.at_least(name, min(ratios), unit, 5)


def accuracy(bench, cases):
    bench.figures.at_least(ACCURACY_ROWS[0][0], 100 * min(case["verification"]["recovered"] for case in cases), "%", 95)
    bench.figures.at_most(ACCURACY_ROWS[1][0], 100 * max(case["verification"]["wrong"] for case in cases), "%", 1)


def identity(bench):
    flags = next((line for line in open("/proc/cpuinfo") if line.startswith("flags")), "").split()
    supported = [name for name, flag in zip(KERNELS, ("sse4_2", "avx2", "avx512vnni")) if flag in flags]
    if len(supported) < 2:
        return bench.figures.skip(*IDENTITY_ROWS[0], "this processor has the scalar kernels only")
    answers = [evaluate(bench, "answers", "40", kernels=name)["hashes"] for name in supported]
    if not answers[0]:
        raise RuntimeError("verification_eval gives no answers to compare")
    bench.figures.at_most(IDENTITY_ROWS[0][0], sum(len(set(of_pair)) > 1 for of_pair in zip(*answers)), "pairs", 0)


def measure(bench):
    cases = evaluate(bench, "speed", PAIRS)["cases"]
    for case in cases:
        print_case(case)
    speed(bench, cases)
    accuracy(bench, cases)
    identity(bench)
