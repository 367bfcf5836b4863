"""The smallest standard block against its committed baseline (tests/pipeline/baseline.json): time beside a reference loop, exact work counters.

RILIEVO_RENEW_BASELINE=1 writes the baseline anew (bench/pipeline/README.md says when)."""
import json
import os
import pathlib
import sys
import unittest

from rilievo_test import RILIEVO, SANITIZED, SOURCE, ProgramTest

sys.path.insert(0, str(SOURCE / "bench" / "pipeline"))
from program import run  # noqa: E402
from standard_blocks import SIMULATED, measure_block  # noqa: E402

BASELINE = pathlib.Path(__file__).resolve().parent / "baseline.json"
LOOP = os.environ.get("RILIEVO_REFERENCE_LOOP", "")
RUNS = 5
WORSE = 1.25


class Baseline(ProgramTest):
    block_options = SIMULATED["simulated-6"]

    def measure(self):
        """{ratio, processor_level, counters}: least CPU time of some runs over that of the loop, in turns; one thread, one set of kernels."""
        env = dict(os.environ, RILIEVO_KERNELS="avx2")
        loop_s, cpu_s, blocks = [], [], []
        for i in range(RUNS):
            loop_s.append(float(run([LOOP]).out))
            block = measure_block(RILIEVO, self.images, self.calibration, self.scratch / f"run-{i}", self.scratch / "trace.json", options=("--threads", "1"), env=env)
            cpu_s.append(block["cpu_s"])
            blocks.append({"pairs": block["pairs"], "points": block["accuracy"]["points"], "rays": block["accuracy"]["rays"], "counters": block["counters"]})
        self.assertTrue(all(block == blocks[0] for block in blocks), "the counters of equal runs differ")
        level = json.loads((self.scratch / "run-0" / "run.json").read_text())["processor_level"]
        return {"ratio": min(cpu_s) / min(loop_s), "processor_level": level, **blocks[0]}

    def test_against_the_baseline(self):
        if SANITIZED or not LOOP:
            self.skipTest("times and bytes are those of the plain build, with its benches")
        if " avx2 " not in pathlib.Path("/proc/cpuinfo").read_text().replace("\n", " "):
            self.skipTest("the baseline was measured with AVX2")
        now = self.measure()
        if os.environ.get("RILIEVO_RENEW_BASELINE"):
            BASELINE.write_text(json.dumps(now, indent=1) + "\n")
        then = json.loads(BASELINE.read_text())
        print(f"CPU time / reference loop: {now['ratio']:.3f}, baseline {then['ratio']:.3f}")
        self.assertEqual(now["pairs"], then["pairs"])
        self.assertEqual({k: v["tasks"] for k, v in now["counters"].items()}, {k: v["tasks"] for k, v in then["counters"].items()})
        if now["processor_level"] == then["processor_level"]:  # libraries choose kernels by it: then every byte is the same
            self.assertEqual(now["counters"], then["counters"])
            self.assertEqual((now["points"], now["rays"]), (then["points"], then["rays"]))
        self.assertLessEqual(now["ratio"], WORSE * then["ratio"], "slower than the baseline allows: see bench/pipeline/README.md")


if __name__ == "__main__":
    unittest.main()
