"""Whole-program tests: runs $RILIEVO as a user does. Standard library only."""
import hashlib
import json
import os
import pathlib
import shutil
import subprocess
import tempfile
import unittest

from faults import artifacts  # noqa: F401 - for the tests

RILIEVO = os.environ.get("RILIEVO", "rilievo")
SOURCE = pathlib.Path(os.environ.get("RILIEVO_SOURCE", pathlib.Path(__file__).resolve().parents[2]))
DATA = pathlib.Path(os.environ.get("RILIEVO_DATA", SOURCE.parent / "shared" / "data"))
SANITIZED = bool(os.environ.get("RILIEVO_SANITIZE"))  # then memory and time are not the program's own
ORIENT_SECONDS = 9000 if SANITIZED else 900


class ProgramTest(unittest.TestCase):
    """Gives each test a scratch folder, and each class one small simulated block."""

    block_options = ("--images", "6", "--width-px", "900", "--height-px", "600")

    @classmethod
    def setUpClass(cls):
        cls.class_scratch = pathlib.Path(tempfile.mkdtemp(prefix="rilievo-test-"))
        cls.block = cls.class_scratch / "block"
        done = rilievo("simulate", *cls.block_options, "--output", cls.block)
        if done.returncode != 0:
            raise AssertionError(f"simulate failed: {done.stderr}")
        cls.images, cls.calibration = cls.block / "images", cls.block / "calibration.toml"

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.class_scratch, ignore_errors=True)

    def setUp(self):
        self.scratch = pathlib.Path(tempfile.mkdtemp(prefix="t-", dir=self.class_scratch))

    def orient(self, images=None, calibration=None, workspace=None, *options, **keywords):
        command = ["orient", images or self.images, "--workspace", workspace or self.scratch / "workspace"]
        if calibration is not False:
            command += ["--calibration", calibration or self.calibration]
        return rilievo(*command, *options, **keywords)

    def report(self, workspace=None):
        done = rilievo("report", workspace or self.scratch / "workspace", "--json")
        self.assertEqual(done.returncode, 0, done.stderr)
        return json.loads(done.stdout)

    def export(self, workspace=None, form="colmap-text", name="export"):
        done = rilievo("export", workspace or self.scratch / "workspace", "--format", form, "--output", self.scratch / name)
        self.assertEqual(done.returncode, 0, done.stderr)
        # Digests: unittest would spend minutes on the difference of two exports.
        return {str(p.relative_to(self.scratch / name)): hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted((self.scratch / name).rglob("*")) if p.is_file()}

    def assert_one_line(self, done, *words, code=1):
        """The contract for errors: the exit code, and one line on stderr that names what, where and what to do."""
        self.assertEqual(done.returncode, code, f"stdout: {done.stdout}\nstderr: {done.stderr}")
        lines = [line for line in done.stderr.splitlines() if line.startswith("rilievo: ") and "WARNING" not in line]
        self.assertEqual(len(lines), 1, done.stderr)
        self.assertNotIn("internal error", done.stderr)
        for word in words:
            self.assertIn(str(word).lower(), lines[0].lower())

    def copy_images(self, name="photos"):
        target = self.scratch / name
        shutil.copytree(self.images, target)
        return target


def rilievo(*arguments, env=None, timeout=ORIENT_SECONDS, **keywords):
    environment = dict(os.environ, **(env or {}))
    return subprocess.run([RILIEVO, *map(str, arguments)], capture_output=True, text=True, env=environment, timeout=timeout, **keywords)


main = unittest.main
