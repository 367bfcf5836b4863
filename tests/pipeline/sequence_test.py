"""Ordered sequences, open and closed, and the reduction of tie points, through the program."""
import json
import math
import sys
import unittest

from rilievo_test import SANITIZED, SOURCE, ProgramTest, main, rilievo

sys.path.insert(0, str(SOURCE / "bench" / "accuracy"))
from bundle_sigma import centre_sigmas, read_model  # noqa: E402
from poses import centre_errors, read_colmap_images  # noqa: E402


class Sequence(ProgramTest):
    def oriented(self, name, *options):
        """(report, folder of the export) of the block under these options."""
        done = self.orient(None, None, self.scratch / name, "--max-features", "1500", *options)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.export(self.scratch / name, name=f"{name}-export")
        return self.report(self.scratch / name), self.scratch / f"{name}-export"

    def test_sequence_and_sparse_agree_within_three_sigma(self):
        sparse, sparse_model = self.oriented("sparse")
        sequence, sequence_model = self.oriented("sequence", "--network", "sequence")
        self.assertEqual((sparse["pairs"], sequence["pairs"]), (15, 9))
        self.assertEqual((sparse["oriented"], sequence["oriented"]), (6, 6))
        triplets = sequence["tie_points"]["triplets"]
        self.assertEqual((triplets["count"], triplets["weak"], triplets["unchecked"]), (4, 0, 0))
        self.assertGreater(triplets["loops"], 1000)
        self.assertIsNone(sparse["tie_points"]["triplets"])
        sigmas = centre_sigmas(sequence_model, sequence["models"][0]["sigma0_px"])
        centres = [{n: c for n, (_, c) in read_colmap_images(m / "images.txt").items()} for m in (sequence_model, sparse_model)]
        differences = centre_errors(*centres)
        self.assertEqual(set(differences), set(sigmas))
        for name, difference in differences.items():
            self.assertLess(sigmas[name], 1e-3, "a bar that any result would pass")  # the block's size is 1
            self.assertLessEqual(difference, 3 * sigmas[name], name)

    def test_only_a_sequence_can_be_closed(self):
        self.assert_one_line(self.orient(None, None, None, "--closed-sequence"), "--closed-sequence", "--network sequence", code=2)

    def test_reduction_keeps_the_cells_and_loses_the_points(self):
        full, _ = self.oriented("full", "--reduction-cell", "150")
        reduced, _ = self.oriented("reduced", "--reduce", "--reduction-cell", "150")
        before, after = reduced["tie_points"]["found"], reduced["tie_points"]["used"]
        self.assertEqual(full["tie_points"], {**reduced["tie_points"], "used": before, "reduced": False})
        self.assertTrue(reduced["tie_points"]["reduced"])
        self.assertLessEqual(after["points"], 0.2 * before["points"])
        self.assertGreaterEqual(after["cells"], 0.95 * before["cells"])
        self.assertGreaterEqual(after["least_common"], 10)
        self.assertGreaterEqual(after["least_links"], min(5, before["least_links"]))
        self.assertEqual(reduced["oriented"], 6)
        self.assertLessEqual(reduced["models"][0]["points"], after["points"])
        self.assertIn("reduced to", rilievo("report", self.scratch / "reduced").stdout)
        self.assertNotIn("reduced to", rilievo("report", self.scratch / "full").stdout)

    def test_the_same_bytes_for_any_threads(self):
        exports = []
        for k, options in enumerate((["--threads", "1"], ["--threads", "3"], ["--serial"])):
            self.assertEqual(self.orient(None, None, self.scratch / f"w{k}", "--network", "sequence", "--reduce", *options).returncode, 0)
            exports.append(self.export(self.scratch / f"w{k}", name=f"e{k}"))
        self.assertEqual(exports[0], exports[1])
        self.assertEqual(exports[0], exports[2])


@unittest.skipIf(SANITIZED, "twenty-four images add nothing there")
class Ring(ProgramTest):
    images_of_ring = 24
    block_options = ("--network", "ring", "--surface", "sphere", "--images", str(images_of_ring), "--width-px", "800", "--height-px", "600")

    def test_a_closed_sequence_has_no_end(self):
        n, errors, across = self.images_of_ring, [], []
        for name, options in (("open", []), ("closed", ["--closed-sequence", "true"])):
            done = self.orient(None, None, self.scratch / name, "--network", "sequence", *options)
            self.assertEqual(done.returncode, 0, done.stderr)
            report = self.report(self.scratch / name)
            self.assertEqual(report["oriented"], n)
            self.assertEqual(len(report["models"]), 1)
            self.assertEqual(report["pairs"], 2 * n if options else 2 * n - 3)
            self.assertEqual(report["tie_points"]["triplets"]["count"], n if options else n - 2)
            self.assertEqual(report["tie_points"]["triplets"]["weak"], 0)
            truth = rilievo("report", self.scratch / name, "--truth", self.block / "scene.json", "--json")
            errors.append(json.loads(truth.stdout)["truth"]["mean_centre_error_relative"])
            self.export(self.scratch / name, name=f"{name}-export")
            _, images, points = read_model(self.scratch / f"{name}-export")
            ends = {i for i, (image, _, _) in images.items() if image in ("image_0001.jpg", f"image_{n:04}.jpg")}
            self.assertEqual(len(ends), 2)
            across.append(sum(ends <= set(seen) for _, seen in points))
        self.assertEqual(across[0], 0)
        self.assertGreater(across[1], 50)
        self.assertLess(max(errors), 1 / 2000)
        self.assertTrue(all(math.isfinite(e) for e in errors))


if __name__ == "__main__":
    main()
