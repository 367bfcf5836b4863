"""Which pairs are matched: guided beside all, a list, positions, matching alone; the same result whatever happens on the way."""
import json
import math
import random
import signal
import subprocess
import time

from exif_gnss import set_gnss
from rilievo_test import RILIEVO, ProgramTest, artifacts, main, rilievo


def verified(report, least=1):
    return {(p["first"], p["second"]) for p in report["pair_list"] if p["model"] != "rejected" and p["inliers"] >= least}


class Ring(ProgramTest):
    """48 images all around a sphere, close to it: an image overlaps some five others on either side."""

    block_options = ("--network", "ring", "--surface", "sphere", "--images", "48", "--width-px", "480", "--height-px", "320", "--distance-m", "1.7")

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.sparse = cls.class_scratch / "sparse"
        done = rilievo("orient", cls.images, "--calibration", cls.calibration, "--workspace", cls.sparse)
        if done.returncode != 0:
            raise AssertionError(f"orient failed: {done.stderr}")

    def guided(self, name="guided", *options):
        workspace = self.scratch / name
        return workspace, self.orient(None, None, workspace, "--network", "guided", *options)

    def test_guided_is_sparse_with_fewer_pairs(self):
        workspace, done = self.guided()
        self.assertEqual(done.returncode, 0, done.stderr)
        all_pairs, few = self.report(self.sparse), self.report(workspace)
        true = verified(all_pairs, 30)
        self.assertGreater(len(true), 100, "the ring is no test of pairs")
        self.assertFalse(true - verified(few), "lost")
        self.assertLessEqual(len(few["pair_list"]), 1.3 * len(true))
        self.assertEqual(few["oriented"], all_pairs["oriented"])
        a, b = all_pairs["models"][0], few["models"][0]
        self.assertLess(abs(a["sigma0_px"] - b["sigma0_px"]), a["sigma0_px"] / math.sqrt(2 * a["redundancy"]))
        # Both are in the datum of the mean of their projection centres, at the mean distance 1 from it: of this ring 1.7 m. Their sigma is
        # the mean error against the exact truth.
        truth = json.loads(rilievo("report", self.sparse, "--json", "--truth", self.block / "scene.json").stdout)["truth"]
        centres = [{i["name"]: i["center"] for i in model["images"]} for model in (a, b)]
        for name, centre in centres[0].items():
            self.assertLess(1.7 * math.dist(centre, centres[1][name]), truth["mean_centre_error_m"], name)

    def test_a_block_of_columns_is_read_once_and_stays(self):
        """48 images in 12 blocks of 4: columns 1 to 11 read their 44 images once, block i is a row of 11 - i other columns, and the one
        tile of column 0 reads its 4. Features take 167 bytes each, and every image's artifact the same beside them."""
        trace, workspace = self.scratch / "trace.json", self.scratch / "traced"
        self.assertEqual(self.orient(None, None, workspace, "--until", "pairs", "--trace", trace).returncode, 0)
        read = {stage: sum(e["args"]["read_bytes"] for e in json.loads(trace.read_text())["traceEvents"] if e["ph"] == "X" and e["cat"] == stage)
                for stage in ("blocks", "pairs")}
        counts = [image["features"] for image in self.report(self.sparse)["image_list"]]
        payloads = sum(p.stat().st_size - 40 for p in (workspace / "artifacts" / "features").rglob("*.art"))
        beside, rest = divmod(payloads - 167 * sum(counts), 48)
        self.assertEqual(rest, 0)
        size = [167 * count + beside for count in counts]
        self.assertEqual(read["blocks"], sum(size[4:]))
        self.assertEqual(read["pairs"], sum(size[:4]) + sum((11 - i // 4) * s for i, s in enumerate(size)))

    def test_guided_gives_the_same_bytes_with_any_threads_and_memory(self):
        exports, names = [], []
        for k, options in enumerate((["--threads", "1"], ["--threads", "2"], ["--serial", "--memory", "420MiB"])):
            workspace, done = self.guided(f"w{k}", *options)
            self.assertEqual(done.returncode, 0, done.stderr)
            exports.append(self.export(workspace, name=f"e{k}"))
            names.append(set(artifacts(workspace)))
        self.assertEqual(exports[0], exports[1])
        self.assertEqual(exports[0], exports[2])
        self.assertEqual(names[0], names[1])
        self.assertEqual(names[0], names[2])

    def test_an_interrupted_guided_run_goes_on(self):
        seconds = -time.monotonic()
        reference, done = self.guided("reference")
        seconds += time.monotonic()
        self.assertEqual(done.returncode, 0, done.stderr)
        expected, files = self.export(reference, name="reference-export"), set(artifacts(reference))
        draw, found = random.Random(7), []
        for trial in range(5):
            workspace = self.scratch / f"w{trial}"
            process = subprocess.Popen([RILIEVO, "orient", str(self.images), "--calibration", str(self.calibration), "--workspace", str(workspace), "--network", "guided"],
                                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            time.sleep(draw.uniform(0.1, 0.9) * seconds)
            process.send_signal(signal.SIGKILL)
            process.wait()
            before = artifacts(workspace)
            found.append(len(before))
            info = rilievo("info", workspace) if (workspace / "run.json").exists() else None
            if info:
                self.assertEqual(info.returncode, 0, info.stderr)
                self.assertIn("guided", info.stdout)
            _, again = self.guided(f"w{trial}")
            self.assertEqual(again.returncode, 0, again.stderr)
            after = artifacts(workspace)
            self.assertEqual(before, {name: after.get(name) for name in before}, "a finished artifact was made again")
            self.assertEqual(set(after), files)
            self.assertEqual(self.export(workspace, name=f"e{trial}"), expected)
        self.assertTrue(any(0 < count < len(files) for count in found), f"no run was killed with a part of its {len(files)} artifacts done: {found}")
        self.assertIn("nothing to do", self.guided("reference")[1].stdout)

    def test_pairs_alone_and_the_orientation_later(self):
        for network in ("sequence", "guided"):
            workspace = self.scratch / network
            first = self.orient(None, None, workspace, "--network", network, "--until", "pairs")
            self.assertEqual(first.returncode, 0, first.stderr)
            self.assertRegex(first.stdout, r"\d+ pairs compared .*verified; .* read and .* written, .* a pair")
            self.assertFalse(any("orientation" in name for name in artifacts(workspace)))
            self.assertIn("not finished", rilievo("info", workspace).stdout)
            self.assertIn("nothing to do: these pairs", self.orient(None, None, workspace, "--network", network, "--until", "pairs").stdout)
            plan = rilievo("plan", self.images, "--calibration", self.calibration, "--workspace", workspace, "--network", network)
            tiles = next(line for line in plan.stdout.splitlines() if line.startswith("tasks")).split(" features, ")[1].split()[0]
            self.assertIn(f" {tiles} pair tiles, 0 orientation", plan.stdout)
            before = artifacts(workspace)
            self.assertEqual(self.orient(None, None, workspace, "--network", network).returncode, 0)
            after = artifacts(workspace)
            self.assertEqual(before, {name: after.get(name) for name in before}, "pairs were matched again")
            self.assertIn("nothing to do: this orientation", self.orient(None, None, workspace, "--network", network, "--until", "pairs").stdout)

    def test_a_plan_of_a_guided_block_says_what_it_can(self):
        plan = rilievo("plan", self.images, "--calibration", self.calibration, "--network", "guided")
        self.assertEqual(plan.returncode, 0, plan.stderr)
        self.assertIn(f"at most {48 * 47 // 2} (guided), 0 known so far", plan.stdout)


class Chosen(ProgramTest):
    def names(self):
        return sorted(p.name for p in self.images.iterdir())

    def write(self, *lines):
        path = self.scratch / "pairs.txt"
        path.write_text("\n".join(lines) + "\n")
        return path

    def test_a_list_of_all_pairs_is_a_sparse_block(self):
        names = self.names()
        listed = self.write(*(f"{a} {b}" for i, a in enumerate(names) for b in names[i + 1:]))
        done = self.orient(None, None, self.scratch / "list", "--network", "list", "--pairs", listed)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(self.orient(None, None, self.scratch / "sparse", "--network", "sparse").returncode, 0)
        self.assertEqual(self.export(self.scratch / "list", name="a"), self.export(self.scratch / "sparse", name="b"))
        self.assertEqual(set(artifacts(self.scratch / "list")), set(artifacts(self.scratch / "sparse")))

    def test_a_list_of_the_pairs_of_a_sequence_matches_what_a_sequence_matches(self):
        """Its tie points are another matter: only a sequence has triplets."""
        names = self.names()
        pairs = [(a, b) for i, a in enumerate(names) for b in names[i + 1:i + 3]]
        listed = self.write("# triplets", *(f'"{b}"\t{a}' if i % 2 else f"{a} {b}" for i, (a, b) in enumerate(pairs)))
        done = self.orient(None, None, self.scratch / "list", "--network", "list", "--pairs", listed)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(self.orient(None, None, self.scratch / "sequence", "--network", "sequence").returncode, 0)
        matched = [{name for name in artifacts(self.scratch / network) if "orientation" not in name} for network in ("list", "sequence")]
        self.assertGreaterEqual(len(matched[0]), len(names) + 1)
        self.assertEqual(*matched)
        # The record alone finds the pairs again: the file is not needed for a report.
        listed.unlink()
        self.assertEqual(len(self.report(self.scratch / "list")["pair_list"]), len(pairs))

    def test_lists_that_are_wrong_say_where(self):
        a, b = self.names()[:2]
        cases = (([f"{a} nobody.jpg"], ("pairs.txt", "line 1", "nobody.jpg")), ([f"{a} {b}", f"{a} {a}"], ("line 2", "itself")), ([f"{a} {b} {a}"], ("line 1", "3 names")),
                 (["# none"], ("no pair",)))
        for lines, words in cases:
            self.assert_one_line(self.orient(None, None, None, "--network", "list", "--pairs", self.write(*lines)), *words)
        self.assert_one_line(self.orient(None, None, None, "--network", "list"), "--pairs", code=2)
        self.assert_one_line(self.orient(None, None, None, "--pairs", self.write(f"{a} {b}")), "--network list", code=2)
        self.assertFalse((self.scratch / "workspace").exists(), "a refused run left something behind")

    def place(self, photos, east_m, missing=()):
        """Images on a line towards the east at 45 degrees north."""
        for path, metres in zip(sorted(photos.iterdir()), east_m):
            set_gnss(path, None if path.name in missing else (45.0, 9.0 + metres / (111320 * math.cos(math.radians(45))), 120.0))

    def spatial(self, photos, *options):
        workspace = self.scratch / "spatial"
        done = self.orient(photos, None, workspace, "--network", "spatial", *options)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done, {(p["first"], p["second"]) for p in self.report(workspace)["pair_list"]}

    def test_images_taken_near_each_other(self):
        photos, names = self.copy_images(), self.names()
        self.place(photos, (0, 1, 2, 3, 4, 5))
        _, pairs = self.spatial(photos, "--neighbours", "0", "--max-distance-m", "2.1")
        self.assertEqual(pairs, {(names[i], names[j]) for i in range(6) for j in range(i + 1, 6) if j - i <= 2})
        self.place(photos, (0, 1, 3, 4, 6.5, 8))
        _, pairs = self.spatial(photos, "--neighbours", "1")
        self.assertEqual(pairs, {(names[0], names[1]), (names[2], names[3]), (names[4], names[5])})

    def test_an_image_without_a_position_goes_with_every_other(self):
        photos, names = self.copy_images(), self.names()
        self.place(photos, (0, 1, 2, 3, 4, 5), missing=names[2:3])
        done, pairs = self.spatial(photos, "--neighbours", "0", "--max-distance-m", "1.1")
        self.assertIn("1 of 6 images have no GNSS position", done.stderr)
        expected = {(names[i], names[j]) for i in range(6) for j in range(i + 1, 6) if 2 in (i, j) or j - i == 1}
        self.assertEqual(pairs, expected)

    def test_no_positions_at_all_are_refused(self):
        self.assert_one_line(self.orient(None, None, None, "--network", "spatial"), "no image has a GNSS position", "--network guided")
        photos = self.copy_images()
        self.place(photos, (0, 100, 200, 300, 400, 500))
        self.assert_one_line(self.orient(photos, None, None, "--network", "spatial", "--max-distance-m", "5"), "no two images", "--max-distance-m")


if __name__ == "__main__":
    main()
