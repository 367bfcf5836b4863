"""rilievo verify and rilievo clean: what they find, what they remove, and above all what they do not."""
import json
import os
import shutil
import signal
import subprocess
import time
import unittest

from rilievo_test import RILIEVO, ProgramTest, artifacts, main, rilievo


def content(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


class Care(ProgramTest):
    def setUp(self):
        super().setUp()
        self.workspace = self.scratch / "workspace"

    def verify(self, *options, code=0):
        done = rilievo("verify", self.workspace, "--json", *options)
        self.assertEqual(done.returncode, code, done.stderr + done.stdout)
        return json.loads(done.stdout)

    def clean(self, *options):
        done = rilievo("clean", self.workspace, "--json", *options)
        self.assertEqual(done.returncode, 0, done.stderr)
        return json.loads(done.stdout)

    def victims(self, stage):
        return sorted((self.workspace / "artifacts" / stage).rglob("*.art"))


class Verify(Care):
    def test_a_sound_workspace(self):
        self.orient()
        before = content(self.workspace)
        found = self.verify("--threads", "2")
        self.assertTrue(found["sound"])
        stages = {stage["name"]: stage for stage in found["stages"]}
        self.assertEqual((stages["features"]["artifacts"], stages["features"]["sound"], stages["features"]["needed_there"]), (6, 6, 6))
        self.assertEqual(stages["orientation"]["needed"], 1)
        self.assertEqual(before, content(self.workspace))
        text = rilievo("verify", self.workspace)
        self.assertIn("all sound", text.stdout)

    def test_names_every_kind_of_damage_and_changes_nothing(self):
        self.orient()
        flipped, cut, empty = self.victims("features")[:3]
        grown, header = self.victims("pairs")[:2]
        for path, change in ((flipped, lambda b: b[:-1] + bytes([b[-1] ^ 1])), (cut, lambda b: b[: len(b) // 2]), (empty, lambda b: b""),
                             (grown, lambda b: b + b"x"), (header, lambda b: bytes([b[0] ^ 1]) + b[1:])):
            path.write_bytes(change(path.read_bytes()))
        (self.workspace / "trace.json").write_text("{\"traceEvents\":[")
        before = content(self.workspace)
        for threads in ("1", "3"):
            found = self.verify("--threads", threads, code=1)
            self.assertEqual(sorted(d["path"] for d in found["damaged"]), sorted(map(str, (flipped, cut, empty, grown, header, self.workspace / "trace.json"))))
        self.assertEqual(before, content(self.workspace))
        text = rilievo("verify", self.workspace)
        self.assertEqual(text.returncode, 1)
        for path in (flipped, cut, empty, grown, header):
            self.assertIn(str(path), text.stdout)

    def test_quarantine_moves_the_damaged_and_orient_makes_them_again(self):
        self.orient()
        expected = self.export()
        for stage in ("features", "pairs", "orientation"):
            victim = self.victims(stage)[0]
            victim.write_bytes(victim.read_bytes()[:-3])
        self.assertEqual(len(self.verify("--quarantine", code=1)["damaged"]), 3)
        found = self.verify()
        self.assertEqual((found["sound"], found["quarantined"]), (True, 3))
        self.assertEqual(self.orient().returncode, 0)
        self.assertEqual(expected, self.export(name="again"))

    def test_a_damaged_record_is_named(self):
        self.orient()
        (self.workspace / "run.json").write_text("{")
        found = self.verify(code=1)
        self.assertEqual([d["path"] for d in found["damaged"]], [str(self.workspace / "run.json")])
        self.assert_one_line(rilievo("clean", self.workspace), "run.json", "damaged", "orient")

    def test_what_is_no_workspace(self):
        self.assert_one_line(rilievo("verify", self.scratch / "none"), "none", "no workspace")
        self.assert_one_line(rilievo("verify", self.images), "no workspace")


class Clean(Care):
    def test_drops_what_other_options_made_and_keeps_the_last_run(self):
        self.orient()
        first = set(artifacts(self.workspace))
        self.assertEqual(self.orient(None, None, None, "--max-features", "700").returncode, 0)
        second = {name: place for name, place in artifacts(self.workspace).items() if name not in first}
        expected = self.export()
        before = content(self.workspace)
        said = self.clean("--dry-run")
        self.assertEqual(before, content(self.workspace))
        done = self.clean()
        self.assertEqual((said["kept"], said["dropped"]), (done["kept"], done["dropped"]))
        self.assertEqual(artifacts(self.workspace), second)
        self.assertEqual(sum(d["files"] for d in done["dropped"].values()), len(first))
        self.assertEqual(sum(d["bytes"] for d in done["dropped"].values()), sum(len(b) for name, b in before.items() if name[len("artifacts/"):] in first))
        again = self.orient(None, None, None, "--max-features", "700")
        self.assertIn("nothing to do", again.stdout)
        self.assertEqual(expected, self.export(name="again"))
        self.assertEqual(self.clean()["dropped"], {})

    def test_guided_blocks_keep_their_sketches_map_and_growth(self):
        self.orient(None, None, None, "--network", "guided")
        before = artifacts(self.workspace)
        self.assertLessEqual({"sketches", "visibility", "growth"}, {name.split("/")[0] for name in before})
        self.assertEqual(self.clean()["dropped"], {})
        self.assertEqual(artifacts(self.workspace), before)
        # Unfinished: what its pairs are follows from results that are gone, so none is dropped.
        for victim in self.victims("growth") + self.victims("orientation"):
            victim.unlink()
        before = artifacts(self.workspace)
        said = self.clean()
        self.assertEqual((said["dropped"], said["pairs_known"]), ({}, False))
        self.assertEqual(artifacts(self.workspace), before)

    def test_removes_what_killed_programs_left_and_what_is_quarantined(self):
        self.orient()
        before = artifacts(self.workspace)
        victim = self.victims("features")[0]
        quarantined = self.workspace / "artifacts" / "quarantine" / "features-x.art"
        quarantined.write_bytes(b"damaged")
        old = victim.with_name(victim.name + ".tmp-00000000-1-1-00000000")
        young = victim.with_name(victim.name + ".tmp-00000000-1-2-00000000")  # of another machine, that may still write
        beside = self.workspace / "run.json.tmp-00000000-1-3-00000000"
        for path in (old, young, beside):
            path.write_bytes(b"12345")
        for path in (old, beside):
            os.utime(path, (time.time() - 2 * 86400,) * 2)
        dropped = self.clean()["dropped"]
        self.assertEqual(dropped, {"quarantine": {"files": 1, "bytes": 7}, "temporaries": {"files": 2, "bytes": 10}})
        self.assertEqual([p.exists() for p in (quarantined, old, beside, young)], [False, False, False, True])
        self.assertEqual(artifacts(self.workspace), before)

    def test_images_that_moved_cost_nothing(self):
        photos = self.copy_images()
        self.assertEqual(self.orient(photos).returncode, 0)
        before = artifacts(self.workspace)
        photos.rename(self.scratch / "elsewhere")
        done = rilievo("clean", self.workspace)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn(str(photos), done.stdout)
        self.assertEqual(artifacts(self.workspace), before)
        self.assertIn("nothing to do", self.orient(self.scratch / "elsewhere").stdout)

    def test_refuses_when_nothing_belongs_to_the_run(self):
        self.orient()
        shutil.copy(self.workspace / "run.json", self.scratch / "run.json")
        record = json.loads((self.workspace / "run.json").read_text())
        for image in record["image_list"]:
            image["content"] = "0" * 64
        (self.workspace / "run.json").write_text(json.dumps(record))
        before = artifacts(self.workspace)
        self.assert_one_line(rilievo("clean", self.workspace), "none of its", "orient")
        self.assertEqual(artifacts(self.workspace), before)

    def test_keeps_off_a_workspace_in_use(self):
        process = subprocess.Popen([RILIEVO, "orient", self.images, "--calibration", self.calibration, "--workspace", self.workspace, "--quiet", "--threads", "1"])
        try:
            deadline = time.time() + 60
            while not list((self.workspace / "artifacts").rglob("*.art")) and time.time() < deadline and process.poll() is None:
                time.sleep(0.005)
            process.send_signal(signal.SIGSTOP)  # in use for as long as we look
            self.assertIsNone(process.poll())
            before = content(self.workspace)
            self.assert_one_line(rilievo("clean", self.workspace), "used by a run")
            self.assertEqual(before, content(self.workspace))
            process.send_signal(signal.SIGCONT)
            self.assertEqual(process.wait(timeout=600), 0)
        finally:
            process.kill()
            process.wait()
        self.assertEqual(self.clean()["dropped"], {})

    def test_a_killed_run_does_not_keep_the_workspace_locked(self):
        process = subprocess.Popen([RILIEVO, "orient", self.images, "--calibration", self.calibration, "--workspace", self.workspace, "--quiet"])
        while not (self.workspace / "run.json").exists() and process.poll() is None:
            time.sleep(0.005)
        process.kill()
        process.wait()
        self.clean()
        self.assertEqual(self.orient().returncode, 0)


if __name__ == "__main__":
    main()
