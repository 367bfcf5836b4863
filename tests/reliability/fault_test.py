"""Each system call of the publish path fails once: one clear line or success, and the same command again gives the same result."""
import os
import random
import resource
import subprocess

from faults import FaultTrials
from rilievo_test import RILIEVO, ProgramTest, main

SHIM = os.environ["RILIEVO_FAULT_SHIM"]
TRIALS = int(os.environ.get("RILIEVO_FAULT_TRIALS", "40"))  # of some 700; scripts/bench engine takes all


class Faults(ProgramTest):
    block_options = ("--images", "4", "--width-px", "420", "--height-px", "320")
    options = ("--max-features", "1500")

    def test_calls_that_fail_once(self):
        trials = FaultTrials(RILIEVO, SHIM, self.images, self.calibration, self.scratch, self.options)
        names = {call.name for call in trials.calls}
        self.assertTrue({"open", "write", "fsync", "close", "rename", "open-folder", "mkdir"} <= names, names)
        # Every kind at every name of call, then more of them at random.
        draw = random.Random(7)
        every = trials.trials()
        draw.shuffle(every)
        seen, first, rest = set(), [], []
        for call, kind in every:
            (rest if (call.name, kind) in seen else first).append((call, kind))
            seen.add((call.name, kind))
        self.assertGreater(len(rest), 300)
        for call, kind in (first + rest)[:TRIALS]:
            with self.subTest(call=f"{call.number} of {len(trials.calls)}: {call.name} {call.path}", kind=kind):
                self.assertEqual(trials.problems(call, kind), [])

    def test_files_limited_in_size(self):
        """A limit of file sizes is met by the large artifacts only: the small ones stay, the line says what to do."""
        trials = FaultTrials(RILIEVO, SHIM, self.images, self.calibration, self.scratch, self.options)
        workspace = self.scratch / "limited"
        limited = subprocess.run([RILIEVO, "orient", *trials.inputs, "--workspace", workspace], capture_output=True, text=True,
                                 preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (40000, 40000)))
        self.assert_one_line(limited, "file too large", "ulimit -f")
        self.assertEqual(trials.orient(workspace).returncode, 0)
        self.assertEqual(trials.exported(workspace), trials.export)


if __name__ == "__main__":
    main()
