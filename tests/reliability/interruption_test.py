"""Kill it, stop it, run it again: the same result, nothing finished made again, nothing left lying about."""
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
        """(export, names of all files of the workspace, seconds of the faster of two runs) of runs that are left alone."""
        seconds = []
        for name in ("warm-up", "reference"):
            start = time.monotonic()
            self.assertEqual(self.orient(None, None, self.scratch / name).returncode, 0)
            seconds.append(time.monotonic() - start)
        workspace = self.scratch / "reference"
        return self.export(workspace, name="reference-export"), self.files(workspace), min(seconds)

    @staticmethod
    def files(workspace):
        return sorted(str(p.relative_to(workspace)) for p in workspace.rglob("*") if p.is_file())

    def run_again(self, workspace, expected, files):
        """The rerun makes what is missing, keeps what is there, and leaves the same files as a run that was left alone; returns how many it found."""
        before = artifacts(workspace)
        done = self.orient(None, None, workspace)
        self.assertEqual(done.returncode, 0, done.stderr)
        after = artifacts(workspace)
        self.assertEqual(before, {name: after.get(name) for name in before}, "a finished artifact was made again")
        self.assertEqual(expected, self.export(workspace, name=f"export-{workspace.name}"))
        self.assertEqual(files, self.files(workspace), "left-over temporary files, or missing ones")
        return len(before)

    def test_kill_at_random_moments(self):
        expected, files, seconds = self.reference()
        draw = random.Random(11)
        killed, found = 0, []
        for trial in range(10):
            workspace = self.scratch / f"w{trial}"
            process = self.start(workspace)
            time.sleep(draw.uniform(0.02, 0.95) * seconds)
            process.kill()
            process.communicate()
            killed += process.returncode == -signal.SIGKILL
            found.append(self.run_again(workspace, expected, files))
        self.assertGreaterEqual(killed, 7, "too few runs were still going when they were killed: this test has shown little")
        complete = sum(1 for name in files if name.endswith(".art"))
        self.assertTrue(any(0 < count < complete for count in found), f"no run was killed with a part of its {complete} artifacts done: {found}")

    def test_ctrl_c_ends_within_a_second_and_keeps_what_is_done(self):
        expected, files, seconds = self.reference()
        stopped, found = 0, []
        for fraction in (0.15, 0.35, 0.55, 0.75, 0.9):
            workspace = self.scratch / f"w{fraction}"
            process = self.start(workspace)
            time.sleep(fraction * seconds)
            process.send_signal(signal.SIGINT)
            asked = time.monotonic()
            _, err = process.communicate(timeout=10)
            if process.returncode != 0:  # it may have been done already
                stopped += 1
                self.assertLess(time.monotonic() - asked, 1.0)
                self.assertEqual(process.returncode, 130, err)
                self.assertIn("cancelled", err)
            found.append(self.run_again(workspace, expected, files))
        self.assertGreaterEqual(stopped, 3, "too few runs were still going when they were stopped: this test has shown little")
        self.assertTrue(any(found), f"no run had finished anything when it was stopped: {found}")


if __name__ == "__main__":
    main()
