"""Kill it, stop it, run it again: the same result, nothing finished made again."""
import random
import signal
import subprocess
import time

from rilievo_test import RILIEVO, ProgramTest, artifacts, main


class Interruption(ProgramTest):
    def start(self, workspace, *options):
        return subprocess.Popen([RILIEVO, "orient", str(self.images), "--calibration", str(self.calibration), "--workspace", str(workspace), *options],
                                stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def reference(self):
        start = time.monotonic()
        self.assertEqual(self.orient(None, None, self.scratch / "reference").returncode, 0)
        return self.export(self.scratch / "reference", name="reference-export"), time.monotonic() - start

    def test_kill_at_random_moments(self):
        expected, seconds = self.reference()
        draw = random.Random(11)
        for trial in range(10):
            workspace = self.scratch / f"w{trial}"
            process = self.start(workspace)
            time.sleep(draw.uniform(0.02, 0.95) * seconds)
            process.kill()
            process.communicate()
            before = artifacts(workspace)
            self.assertEqual(self.orient(None, None, workspace).returncode, 0)
            after = artifacts(workspace)
            self.assertEqual(before, {name: after.get(name) for name in before}, "a finished artifact was made again")
            self.assertEqual(expected, self.export(workspace, name=f"e{trial}"))
            self.assertFalse([p for p in (workspace / "artifacts").rglob("*") if p.is_file() and p.suffix != ".art"], "left-over temporary files")

    def test_ctrl_c_ends_within_a_second_and_keeps_what_is_done(self):
        expected, seconds = self.reference()
        for fraction in (0.15, 0.5, 0.9):
            workspace = self.scratch / f"w{fraction}"
            process = self.start(workspace)
            time.sleep(fraction * seconds)
            process.send_signal(signal.SIGINT)
            asked = time.monotonic()
            _, err = process.communicate(timeout=10)
            if process.returncode != 0:  # it may have been done already
                self.assertLess(time.monotonic() - asked, 1.0)
                self.assertEqual(process.returncode, 130, err)
                self.assertIn("cancelled", err)
            self.assertEqual(self.orient(None, None, workspace).returncode, 0)
            self.assertEqual(expected, self.export(workspace, name=f"e{fraction}"))


if __name__ == "__main__":
    main()
