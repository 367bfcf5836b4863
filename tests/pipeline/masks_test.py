"""Masks of a block: what is found, what is refused, what is computed again."""
import json
import re
import shutil

from png import png
from rilievo_test import ProgramTest, artifacts, main, rilievo

WIDTH, HEIGHT = 900, 600
LEFT = png(WIDTH, HEIGHT, lambda y: b"\xff" * 600 + b"\0" * 300)
WHITE = png(WIDTH, HEIGHT, lambda y: b"\x80" * WIDTH)


class Masks(ProgramTest):
    def setUp(self):
        super().setUp()
        self.names = sorted(path.name for path in self.images.iterdir())
        self.masks = self.scratch / "masks"
        self.masks.mkdir()

    def fill(self, content=WHITE, name=lambda image: image.rsplit(".", 1)[0] + ".png", images=None):
        for image in images or self.names:
            path = self.masks / name(image)
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(content)

    def counts(self, workspace=None):
        return {image["name"]: image["features"] for image in self.report(workspace)["image_list"]}

    def masked(self, *options, name="workspace", images=None):
        done = self.orient(images, None, self.scratch / name, "--masks", self.masks, *options)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done

    def test_white_masks_change_no_feature_and_dark_ones_remove_theirs(self):
        self.assertEqual(self.orient(None, None, self.scratch / "free").returncode, 0)
        free = self.counts(self.scratch / "free")
        self.fill()
        self.assertNotIn("WARNING", self.masked(name="white").stderr)
        self.assertEqual(self.counts(self.scratch / "white"), free)
        self.fill(LEFT, images=self.names[:2])
        self.masked(name="left")
        left = self.counts(self.scratch / "left")
        table = self.scratch / "list.csv"
        for name in self.names:
            done = rilievo("features", self.images / name, "--output", table)
            self.assertEqual(done.returncode, 0, done.stderr)
            rows = table.read_text().splitlines()[1:]
            expected = sum(1 for row in rows if float(row.split(",")[0]) < 600) if name in self.names[:2] else len(rows)
            self.assertEqual(left[name], expected)
            self.assertLessEqual(expected, free[name])
        self.assertLess(left[self.names[0]], free[self.names[0]])

    def test_a_changed_mask_makes_only_its_images_features_again(self):
        self.fill()
        self.masked()
        before = artifacts(self.scratch / "workspace")
        self.assertIn("nothing to do", self.masked().stdout)
        self.fill(LEFT, images=self.names[3:4])
        self.masked()
        after = artifacts(self.scratch / "workspace")
        self.assertEqual({name: after[name] for name in before}, before)
        self.assertEqual(sum(1 for name in after.keys() - before.keys() if name.startswith("features/")), 1)
        shutil.rmtree(self.masks)  # reports need neither images nor masks
        self.assertEqual(self.report()["oriented"], 6)
        self.assertIn("6 of 6 images", rilievo("info", self.scratch / "workspace").stdout)

    def test_without_masks_the_keys_are_those_of_before(self):
        self.fill(images=self.names[:1])
        done = self.masked()
        warnings = [line for line in done.stderr.splitlines() if "have no mask" in line]
        self.assertEqual(len(warnings), 1, done.stderr)
        self.assertIn("5 of 6 images", warnings[0])
        self.assertTrue(any("5 of 6" in warning for warning in self.report()["warnings"]))
        masked = {name for name in artifacts(self.scratch / "workspace") if name.startswith("features/")}
        self.assertEqual(self.orient(None, None, self.scratch / "free").returncode, 0)
        free = {name for name in artifacts(self.scratch / "free") if name.startswith("features/")}
        self.assertEqual(len(masked & free), 5)

    def test_names_of_masks(self):
        for k, name in enumerate((lambda image: image, lambda image: image + ".png", lambda image: image.rsplit(".", 1)[0] + ".PNG")):
            shutil.rmtree(self.masks)
            self.masks.mkdir()
            self.fill(LEFT, name)  # a PNG whatever it is called: the content tells
            done = rilievo("plan", self.images, "--calibration", self.calibration, "--masks", self.masks)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertNotIn("WARNING", done.stderr, k)
        self.fill(WHITE, lambda image: image.rsplit(".", 1)[0] + ".tif", self.names[:1])
        self.assert_one_line(self.orient(None, None, None, "--masks", self.masks), "may both be the mask", self.names[0].rsplit(".", 1)[0])

    def test_folders_of_masks_mirror_those_of_images(self):
        photos = self.scratch / "photos"
        for side, names in (("a", self.names[:3]), ("b", self.names[3:])):
            (photos / side).mkdir(parents=True)
            for name in names:
                shutil.copy(self.images / name, photos / side)
        self.masks = photos / "masks"  # below the images, where they are no photographs
        for side, names in (("a", self.names[:3]), ("b", self.names[3:])):
            (self.masks / side).mkdir(parents=True)
            for name in names:
                (self.masks / side / (name + ".png")).write_bytes(WHITE)
        done = self.masked(images=photos)
        self.assertNotIn("WARNING", done.stderr)
        self.assertEqual(sorted(self.counts()), sorted([f"a/{name}" for name in self.names[:3]] + [f"b/{name}" for name in self.names[3:]]))

    def test_masks_that_cannot_be_used_are_named_before_the_run(self):
        self.fill()
        victim = self.names[2].rsplit(".", 1)[0] + ".png"
        for content, words in ((png(600, 900, lambda y: bytes(600)), ("600 x 900", "900 x 600", self.names[2])), (b"no image", ("no JPEG",)),
                               (png(WIDTH, HEIGHT, lambda y: bytes(2 * WIDTH), bits=16), ("16 bits",))):
            (self.masks / victim).write_bytes(content)
            for done in (self.orient(None, None, None, "--masks", self.masks), rilievo("plan", self.images, "--calibration", self.calibration, "--masks", self.masks)):
                self.assert_one_line(done, victim, *words)
        self.assertFalse((self.scratch / "workspace").exists())
        self.assert_one_line(self.orient(None, None, None, "--masks", self.scratch / "absent"), "absent")
        self.assert_one_line(self.orient(None, None, None, "--masks", self.images), "folder of the images", code=2)
        shutil.rmtree(self.masks)
        self.masks.mkdir()
        (self.masks / "other.png").write_bytes(WHITE)
        self.assert_one_line(self.orient(None, None, None, "--masks", self.masks), "none of its files")

    def test_a_damaged_mask_quarantines_its_image(self):
        self.fill()
        victim = self.masks / (self.names[0].rsplit(".", 1)[0] + ".png")
        content = bytearray(victim.read_bytes())
        content[-20] ^= 1
        victim.write_bytes(content)
        self.masked()
        report = self.report()
        self.assertEqual(report["oriented"], 5)
        self.assertEqual([q["name"] for q in report["quarantined"]], [self.names[0]])
        self.assertIn("mask " + victim.name, report["quarantined"][0]["reason"])

    def test_memory_counts_the_mask(self):
        def peak(*options):
            done = rilievo("plan", self.images, "--calibration", self.calibration, "--max-features", "100", *options)
            self.assertEqual(done.returncode, 0, done.stderr)
            return float(re.search(r"largest task ([0-9.]+) MiB \(features", done.stdout).group(1))
        free = peak()
        self.fill()
        self.assertGreater(peak("--masks", self.masks), free)

    def test_a_scene_file_takes_masks_too(self):
        self.fill(LEFT)
        done = self.orient(self.block / "scene.json", False, None, "--masks", self.masks)
        self.assertEqual(done.returncode, 0, done.stderr)
        record = json.loads((self.scratch / "workspace" / "run.json").read_text())
        self.assertTrue(all("mask" in image for image in record["image_list"]))


if __name__ == "__main__":
    main()
