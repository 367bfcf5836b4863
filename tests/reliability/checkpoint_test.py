"""The program is killed while it maps: it goes on from its last checkpoint, to the same bytes."""
import os
import re
import signal

from faults import FaultTrials, digests
from rilievo_test import RILIEVO, ProgramTest, main


class Checkpoints(ProgramTest):
    block_options = ("--images", "8", "--width-px", "420", "--height-px", "320")

    def trials(self):
        return FaultTrials(RILIEVO, os.environ["RILIEVO_FAULT_SHIM"], self.images, self.calibration, self.scratch, ("--max-features", "1500"))

    def killed_at(self, trials, call):
        workspace = self.scratch / f"killed-{call.number}"
        done = trials.orient(workspace, {"RILIEVO_FAULT_CALL": str(call.number), "RILIEVO_FAULT_KIND": "kill"})
        self.assertEqual(done.returncode, -signal.SIGKILL)
        return workspace

    def test_goes_on_where_it_was_killed(self):
        trials = self.trials()
        # Checkpoints are published by renames; each call of the mapping comes after one of them, up to the orientation's.
        published = [call for call in trials.calls if call.name == "rename" and "/checkpoints/" in call.path]
        self.assertGreaterEqual(len(published), 5)
        self.assertFalse(any(name.startswith("artifacts/checkpoints") for name in trials.files), "a checkpoint outlives its orientation")
        taken_over = []
        for i, call in enumerate(published):  # killed just before it is published
            workspace = self.killed_at(trials, call)
            self.assertEqual(sum(1 for _ in (workspace / "artifacts" / "checkpoints").rglob("*.art")), min(i, 1))
            again = trials.orient(workspace)
            self.assertEqual(again.returncode, 0, again.stderr)
            found = re.search(r"mapping went on from its last checkpoint, with (\d+) of 8 images", again.stdout)
            taken_over.append(int(found[1]) if found else 0)
            self.assertEqual(digests(workspace / "artifacts"), trials.artifacts)
            self.assertEqual(trials.exported(workspace), trials.export)
        self.assertEqual(taken_over[0], 0)
        self.assertTrue(all(count >= 2 for count in taken_over[1:]), taken_over)
        self.assertEqual(taken_over[-1], 8)

    def test_damaged_checkpoint_is_not_trusted(self):
        trials = self.trials()
        last = [call for call in trials.calls if call.name == "rename" and "/checkpoints/" in call.path][-1]
        workspace = self.killed_at(trials, last)
        [checkpoint] = (workspace / "artifacts" / "checkpoints").rglob("*.art")
        content = bytearray(checkpoint.read_bytes())
        content[len(content) // 2] ^= 1
        checkpoint.write_bytes(content)
        again = trials.orient(workspace)
        self.assertEqual(again.returncode, 0, again.stderr)
        self.assertNotIn("went on from", again.stdout)
        self.assertEqual(trials.exported(workspace), trials.export)


if __name__ == "__main__":
    main()
