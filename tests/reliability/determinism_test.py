"""One hash of all exports, whatever the threads, the executor, the memory, the strips, the order of the files and the interruptions."""
import hashlib
import random
import shutil
import signal
import subprocess
import time

from faults import digests
from rilievo_test import RILIEVO, ProgramTest, main, rilievo


class Determinism(ProgramTest):
    block_options = ("--images", "6", "--width-px", "700", "--height-px", "500")

    def exports(self, workspace):
        """One digest over the files of all formats."""
        files = {}
        for form in ("colmap-text", "colmap-binary", "bundler", "ply"):
            output = self.scratch / f"{workspace.name}-{form}"
            done = rilievo("export", workspace, "--format", form, "--output", output)
            self.assertEqual(done.returncode, 0, done.stderr)
            files.update({f"{form}/{name}": digest for name, digest in digests(output).items()})
        self.assertGreaterEqual(len(files), 6)
        return hashlib.sha256(repr(sorted(files.items())).encode()).hexdigest()

    def shuffled(self):
        """The photographs written in another order: a folder lists them in another one."""
        folder = self.scratch / "shuffled"
        folder.mkdir()
        paths = sorted(self.images.iterdir())
        random.Random(3).shuffle(paths)
        for path in paths:
            shutil.copyfile(path, folder / path.name)
        return folder

    def interrupted(self, workspace, seconds, network):
        draw = random.Random(4)
        for _ in range(3):
            process = subprocess.Popen([RILIEVO, "orient", self.images, "--calibration", self.calibration, "--workspace", workspace, "--network", network],
                                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            time.sleep(draw.uniform(0.1, 0.5) * seconds)
            process.send_signal(signal.SIGKILL)
            process.wait()

    def one_hash(self, network):
        cases = {f"threads {n}": ("--threads", n) for n in (1, 2, 4, 8)}
        cases.update({"serial": ("--serial",), "little memory": ("--memory", "400MiB"), "narrow strips": ("--strip-width", 100), "odd strips": ("--strip-width", 333)})
        hashes, seconds = {}, 0
        for name, options in cases.items():
            start = time.monotonic()
            done = self.orient(None, None, self.scratch / name, "--network", network, *options)
            seconds = time.monotonic() - start
            self.assertEqual(done.returncode, 0, f"{name}: {done.stderr}")
            hashes[name] = self.exports(self.scratch / name)
        self.assertEqual(self.orient(self.shuffled(), None, self.scratch / "other order", "--network", network).returncode, 0)
        hashes["other order"] = self.exports(self.scratch / "other order")
        self.interrupted(self.scratch / "interrupted", seconds, network)
        self.assertEqual(self.orient(None, None, self.scratch / "interrupted", "--network", network).returncode, 0)
        hashes["interrupted"] = self.exports(self.scratch / "interrupted")
        self.assertEqual(len(set(hashes.values())), 1, hashes)

    def test_all_pairs(self):
        self.one_hash("sparse")

    def test_guided_pairs(self):
        self.one_hash("guided")


if __name__ == "__main__":
    main()
