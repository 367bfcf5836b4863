"""The main job on a small simulated block: orientation, report, exports, reruns, and what users do to a workspace."""
import json
import os
import shutil
import subprocess
import threading
import unittest

from rilievo_test import RILIEVO, SANITIZED, ProgramTest, artifacts, main, rilievo


class Orient(ProgramTest):
    def test_orients_reports_and_exports(self):
        done = self.orient()
        self.assertEqual(done.returncode, 0, done.stderr)
        report = self.report()
        self.assertEqual(report["oriented"], 6)
        self.assertEqual(len(report["models"]), 1)
        self.assertGreater(report["models"][0]["points"], 200)
        self.assertLess(report["models"][0]["sigma0_px"], 1.0)
        truth = rilievo("report", self.scratch / "workspace", "--json", "--truth", self.block / "scene.json")
        self.assertLess(json.loads(truth.stdout)["truth"]["mean_centre_error_relative"], 1 / 2000)
        for form, names in (("colmap-text", {"cameras.txt", "images.txt", "points3D.txt"}), ("colmap-binary", {"cameras.bin", "images.bin", "points3D.bin"})):
            self.assertLessEqual(names, set(self.export(form=form, name=form)))
        self.assertTrue(self.export(form="bundler", name="bundler"))
        self.assertTrue(self.export(form="ply", name="ply"))
        info = rilievo("info", self.scratch / "workspace")
        self.assertIn("6 of 6 images", info.stdout)

    def test_other_descriptors_orient_as_well(self):
        workspace = self.scratch / "workspace"
        self.assertEqual(self.orient().returncode, 0)
        for detector in ("gloh", "pca-sift"):
            with self.subTest(detector):
                before = set(artifacts(workspace))
                done = self.orient(None, None, workspace, "--detector", detector)
                self.assertEqual(done.returncode, 0, done.stderr)
                made = set(artifacts(workspace)) - before
                self.assertEqual(len([name for name in made if name.startswith("features")]), 6)
                self.assertEqual(self.report()["oriented"], 6)
                truth = rilievo("report", workspace, "--json", "--truth", self.block / "scene.json")
                self.assertLess(json.loads(truth.stdout)["truth"]["mean_centre_error_relative"], 1 / 2000)

    def test_straight_from_the_scene_file_without_disk(self):
        done = self.orient(self.block / "scene.json", False)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(self.report()["oriented"], 6)

    def test_the_same_command_again_does_nothing_and_says_so(self):
        self.orient()
        before = artifacts(self.scratch / "workspace")
        again = self.orient()
        self.assertEqual(again.returncode, 0)
        self.assertIn("nothing to do", again.stdout)
        self.assertEqual(before, artifacts(self.scratch / "workspace"))

    def test_threads_and_executors_give_the_same_bytes(self):
        exports = []
        for k, options in enumerate((["--threads", "1"], ["--threads", "2"], ["--serial"])):
            workspace = self.scratch / f"w{k}"
            self.assertEqual(self.orient(None, None, workspace, *options).returncode, 0)
            exports.append(self.export(workspace, name=f"e{k}"))
        self.assertEqual(exports[0], exports[1])
        self.assertEqual(exports[0], exports[2])

    def test_a_damaged_artifact_is_made_again(self):
        self.orient()
        expected = self.export()
        workspace = self.scratch / "workspace"
        for stage in ("features", "pairs", "orientation"):
            victim = next((workspace / "artifacts" / stage).rglob("*.art"))
            content = bytearray(victim.read_bytes())
            content[len(content) // 2] ^= 1
            victim.write_bytes(content)
        self.assertEqual(self.orient().returncode, 0)
        self.assertEqual(expected, self.export(name="again"))
        self.assertTrue(any((workspace / "artifacts" / "quarantine").iterdir()))

    def test_two_programs_in_one_workspace(self):
        self.assertEqual(self.orient(None, None, self.scratch / "alone").returncode, 0)
        results = []
        threads = [threading.Thread(target=lambda: results.append(self.orient())) for _ in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual([r.returncode for r in results], [0, 0], [r.stderr for r in results])
        self.assertEqual(self.report()["oriented"], 6)
        self.assertEqual(self.export(self.scratch / "alone", name="export-alone"), self.export())
        self.assertEqual(set(artifacts(self.scratch / "alone")), set(artifacts(self.scratch / "workspace")))

    def test_an_image_folder_that_moved(self):
        photos = self.copy_images()
        self.orient(photos)
        before = artifacts(self.scratch / "workspace")
        moved = photos.rename(self.scratch / "moved")
        self.assertEqual(self.report()["oriented"], 6)
        info = rilievo("info", self.scratch / "workspace")
        self.assertIn("not there any more", info.stdout)
        self.assertIn("nothing to do", self.orient(moved).stdout)
        self.assertEqual(before, artifacts(self.scratch / "workspace"))

    def test_a_workspace_of_another_version(self):
        self.orient()
        record = self.scratch / "workspace" / "run.json"
        content = json.loads(record.read_text())
        content["version"] = 0
        record.write_text(json.dumps(content))
        self.assert_one_line(self.orient(), "format 0", "new --workspace")
        self.assert_one_line(rilievo("report", self.scratch / "workspace"), "format 0")

    def test_a_path_with_spaces_and_other_letters(self):
        photos = self.copy_images("Fotografie dell'Arco – Übersicht")
        workspace = self.scratch / "là già"
        calibration = shutil.copy(self.calibration, self.scratch / "câmera 1.toml")
        self.assertEqual(self.orient(photos, calibration, workspace).returncode, 0)
        self.assertEqual(self.report(workspace)["oriented"], 6)

    def test_sequence_mode_matches_only_the_triplets_pairs(self):
        self.assertEqual(self.orient(None, None, None, "--network", "sequence").returncode, 0)
        report = self.report()
        self.assertEqual(report["pairs"], 2 * 6 - 3)
        self.assertEqual(report["oriented"], 6)

    def test_an_options_file_and_the_command_line_over_it(self):
        options = self.scratch / "options.toml"
        options.write_text('ratio = 0.7\nmax-features = 3000\nnetwork = "sequence"\n')
        done = self.orient(None, None, None, "--options", options, "--ratio", "0.75")
        self.assertEqual(done.returncode, 0, done.stderr)
        record = json.loads((self.scratch / "workspace" / "run.json").read_text())["options"]
        self.assertEqual((record["matching"]["ratio"], record["features"]["max-features"], record["network"]), ("0.75", "3000", "sequence"))
        for content, word in (("no-such-thing = 1\n", "no-such-thing"), ("ratio = 7\n", "ratio"), ("ratio\n", "options.toml")):
            options.write_text(content)
            self.assert_one_line(self.orient(None, None, self.scratch / "other", "--options", options), word, code=2)
        self.assert_one_line(self.orient(None, None, self.scratch / "other", "--options", self.scratch / "absent.toml"), "absent.toml", code=2)

    def test_options_may_stand_before_the_images(self):
        done = rilievo("orient", "--calibration", self.calibration, self.images, "--workspace", self.scratch / "workspace")
        self.assertEqual(done.returncode, 0, done.stderr)

    def test_a_refused_run_changes_nothing(self):
        self.orient()
        before = self.report()
        self.assert_one_line(self.orient(None, None, None, "--max-features", "1000000", "--memory", "1GiB"), "--memory", "use")
        self.assertEqual(before, self.report())
        self.assert_one_line(self.orient(None, None, self.scratch / "fresh", "--memory", "168MiB"), "--memory")
        self.assertFalse((self.scratch / "fresh").exists())

    def test_plan_says_what_it_would_do(self):
        done = rilievo("plan", self.images, "--calibration", self.calibration, "--memory", "2GiB")
        self.assertEqual(done.returncode, 0, done.stderr)
        for word in ("pairs", "15", "memory", "disk", "time"):
            self.assertIn(word, done.stdout)

    def test_trace_and_json_progress(self):
        trace = self.scratch / "trace.json"
        done = self.orient(None, None, None, "--trace", trace, "--progress", "json")
        self.assertEqual(done.returncode, 0, done.stderr)
        events = json.loads(trace.read_text())
        spans = [e for e in (events["traceEvents"] if isinstance(events, dict) else events) if e.get("ph") == "X" and e["cat"] != "loop"]
        self.assertEqual(sum(1 for e in spans if e.get("cat") == "features"), 6)
        lines = done.stderr.splitlines()
        self.assertTrue(lines)
        for line in lines:  # a program reads all of stderr
            self.assertIsInstance(json.loads(line), dict, line)
        quiet = self.orient(None, None, self.scratch / "other", "--quiet")
        self.assertEqual((quiet.stdout, quiet.stderr), ("", ""))

    @unittest.skipIf(SANITIZED, "a sanitizer's own memory would be measured")
    def test_memory_stays_below_the_limit(self):
        for limit_mib in (310, 600, 1024):
            for threads in (2, 8):
                with self.subTest(limit_mib=limit_mib, threads=threads):
                    workspace = self.scratch / f"w-{limit_mib}-{threads}"
                    process = subprocess.Popen([RILIEVO, "orient", self.images, "--calibration", self.calibration, "--workspace", workspace, "--quiet",
                                                "--memory", f"{limit_mib}MiB", "--threads", str(threads)])
                    _, status, usage = os.wait4(process.pid, 0)  # the kernel's own account of the process: ru_maxrss is its VmHWM
                    process.returncode = os.waitstatus_to_exitcode(status)
                    self.assertEqual(process.returncode, 0)
                    self.assertLessEqual(usage.ru_maxrss / 1024, limit_mib)
                    self.assertEqual(self.report(workspace)["oriented"], 6)

    def test_json_progress_is_json_with_warnings_too(self):
        done = rilievo("orient", self.images, "--workspace", self.scratch / "workspace", "--progress", "json")
        for line in done.stderr.splitlines():
            if not line.startswith("rilievo: error"):
                self.assertIsInstance(json.loads(line), dict, line)


if __name__ == "__main__":
    main()
