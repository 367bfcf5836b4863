"""Images that come, go or change: what is still valid is used again, and the result is that of a fresh run."""
import json
import os
import re
import shutil
import signal

from faults import artifacts
from rilievo_test import ProgramTest, main


def shim(workspace, call, log):
    """The environment of a run that is killed at this call of its publish path (0: never)."""
    return {"LD_PRELOAD": os.environ["RILIEVO_FAULT_SHIM"], "RILIEVO_FAULT_UNDER": str(workspace.resolve()), "RILIEVO_FAULT_CALL": str(call), "RILIEVO_FAULT_KIND": "kill",
            "RILIEVO_FAULT_LOG": str(log), "ASAN_OPTIONS": os.environ.get("ASAN_OPTIONS", "") + ":verify_asan_link_order=0"}


class Reuse(ProgramTest):
    block_options = ("--images", "7", "--width-px", "600", "--height-px", "450")

    def setUp(self):
        super().setUp()
        self.photos = self.copy_images()
        self.names = sorted(path.name for path in self.photos.iterdir())
        self.workspace = self.scratch / "workspace"

    def run_here(self, *options):
        """({stage: (tasks, tasks that found their result)}, (pairs, pairs compared now)) of a run in the workspace."""
        trace = self.scratch / "trace.json"
        done = self.orient(self.photos, None, self.workspace, "--trace", trace, *options)
        self.assertEqual(done.returncode, 0, done.stderr)
        stages = {}
        for event in json.loads(trace.read_text())["traceEvents"]:
            if event["ph"] == "X" and event["cat"] != "loop":
                made, reused = stages.get(event["cat"], (0, 0))
                stages[event["cat"]] = (made + 1, reused + event["args"]["reused"])
        pairs = re.search(r"(\d+) pairs compared \((\d+) of them now\)", done.stdout)
        return stages, tuple(map(int, pairs.groups()))

    def expect_fresh_result(self):
        fresh = self.scratch / "fresh"
        shutil.rmtree(fresh, ignore_errors=True)
        self.assertEqual(self.orient(self.photos, None, fresh).returncode, 0)
        self.assertEqual(self.export(self.workspace, name="here"), self.export(fresh, name="elsewhere"))

    def put_aside(self, name):
        (self.photos / name).rename(self.scratch / name)

    def put_back(self, name):
        (self.scratch / name).rename(self.photos / name)

    def test_image_added(self):
        """First, in the middle or last: its own pairs are compared, and no others, though every tile of pairs is cut differently."""
        for number, position in enumerate((0, 3, 6)):
            with self.subTest(position=position):
                self.workspace = self.scratch / f"added-{number}"
                self.put_aside(self.names[position])
                stages, pairs = self.run_here()
                self.assertEqual(stages["features"], (6, 0))
                self.assertEqual(pairs, (15, 15))
                before = artifacts(self.workspace)
                self.put_back(self.names[position])
                stages, pairs = self.run_here()
                self.assertEqual(stages["features"], (7, 6))
                self.assertEqual(pairs, (21, 6))
                after = artifacts(self.workspace)
                self.assertEqual(before, {name: after.get(name) for name in before})
                self.expect_fresh_result()
                self.assertFalse((self.workspace / "former-run.json").exists())

    def test_image_removed(self):
        self.run_here()
        self.put_aside(self.names[2])
        stages, pairs = self.run_here()
        self.assertEqual(stages["features"], (6, 6))
        self.assertEqual(pairs, (15, 0))
        self.expect_fresh_result()

    def test_killed_between(self):
        """A run with one image more is killed after its second tile of pairs: what the one before it had compared is not lost."""
        self.put_aside(self.names[3])
        self.run_here()
        self.put_back(self.names[3])
        copy, log = self.scratch / "copy", self.scratch / "calls"
        shutil.copytree(self.workspace, copy)
        self.assertEqual(self.orient(self.photos, None, copy, "--threads", 1, env=shim(copy, 0, log)).returncode, 0)
        tiles = [i + 1 for i, line in enumerate(log.read_text().splitlines()) if line.startswith("rename ") and "/artifacts/pairs/" in line]
        self.assertGreater(len(tiles), 3)
        self.assertEqual(self.orient(self.photos, None, self.workspace, "--threads", 1, env=shim(self.workspace, tiles[2], self.scratch / "calls-killed")).returncode, -signal.SIGKILL)
        self.assertTrue((self.workspace / "former-run.json").exists())
        _, pairs = self.run_here()
        self.assertEqual(pairs[0], 21)
        self.assertLessEqual(pairs[1], 6)
        self.expect_fresh_result()

    def test_changed_content_under_the_same_name(self):
        """A changed image: its features and its pairs."""
        self.run_here()
        changed = self.photos / self.names[4]
        with open(changed, "ab") as file:
            file.write(b"\xff\xfe\x00\x08change")  # the pixels are the same, the content is not
        stages, pairs = self.run_here()
        self.assertEqual(stages["features"], (7, 6))
        self.assertEqual(pairs, (21, 6))
        self.expect_fresh_result()


if __name__ == "__main__":
    main()
