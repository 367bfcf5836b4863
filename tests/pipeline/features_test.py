"""rilievo features: counts, lists and drawings of one image, masks, and every kind of bad input."""
import csv
import json
import math
import random
import struct

from png import png, png_size
from rilievo_test import ProgramTest, main, rilievo


def noise(width, channels=1, width_bytes=1, seed=3):
    draw = random.Random(seed)
    return lambda y: draw.randbytes(width * channels * width_bytes)


class Features(ProgramTest):
    def setUp(self):
        super().setUp()
        self.image = sorted(self.images.iterdir())[0]

    def write(self, name, content):
        path = self.scratch / name
        path.write_bytes(content)
        return path

    def features(self, image, *options):
        """(summary, rows of the list) of a run that must succeed."""
        table = self.scratch / "features.csv"
        done = rilievo("features", image, "--json", "--output", table, "--progress", "quiet", *options)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        summary = json.loads(done.stdout)
        with table.open() as file:
            rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
        self.assertEqual(len(rows), summary["features"])
        return summary, rows

    def test_summary_and_list_agree(self):
        summary, rows = self.features(self.image)
        self.assertGreater(len(rows), 300)
        self.assertEqual((summary["width_px"], summary["height_px"]), (900, 600))
        cells = {(int(8 * row["x_px"] / 900), int(8 * row["y_px"] / 600)) for row in rows}
        self.assertAlmostEqual(summary["coverage"], len(cells) / 64)
        scales = sorted(row["scale_px"] for row in rows)
        self.assertAlmostEqual(summary["scale_px"]["min"], scales[0], places=4)
        self.assertAlmostEqual(summary["scale_px"]["max"], scales[-1], places=3)
        for row in rows:
            self.assertTrue(0 <= row["x_px"] <= 900 and 0 <= row["y_px"] <= 600 and row["scale_px"] > 0 and row["response"] > 0, row)
            self.assertTrue(-180 <= row["angle_deg"] <= 360, row)
        text = rilievo("features", self.image)
        self.assertEqual(text.returncode, 0, text.stderr)
        for word in ("900 x 600", str(len(rows)), "coverage", "to decode"):
            self.assertIn(word, text.stdout)
        quiet = rilievo("features", self.image, "--quiet")
        self.assertEqual((quiet.returncode, quiet.stdout, quiet.stderr), (0, "", ""))

    def test_the_list_does_not_depend_on_threads(self):
        lists = [self.features(self.image, *options)[1] for options in (["--threads", "1"], ["--threads", "2"], ["--serial"])]
        self.assertEqual(lists[0], lists[1])
        self.assertEqual(lists[0], lists[2])

    def test_the_report_of_orient_says_the_same_also_of_images_left_out(self):
        photos = self.copy_images()
        stranger = photos / "stranger.png"  # has features and cannot be oriented
        stranger.write_bytes(png(900, 600, noise(900)))
        self.assertEqual(self.orient(photos).returncode, 0)
        report = self.report()
        self.assertEqual([u["name"] for u in report["unoriented"]], [stranger.name])
        listed = {image["name"]: (image["features"], image["feature_coverage"]) for image in report["image_list"]}
        text = rilievo("report", self.scratch / "workspace").stdout
        for path in (photos / self.image.name, stranger):
            summary = self.features(path)[0]
            self.assertEqual(listed[path.name], (summary["features"], summary["coverage"]))
            line = next(line for line in text.splitlines() if path.name in line)
            self.assertIn(str(summary["features"]), line)
            self.assertIn(f"{100 * summary['coverage']:.1f} %", line)

    def test_the_strongest_are_kept(self):
        every, few = self.features(self.image)[1], self.features(self.image, "--max-features", "100")[1]
        self.assertEqual(len(few), 100)
        strongest = sorted((row["response"] for row in every), reverse=True)[:100]
        self.assertEqual(sorted((row["response"] for row in few), reverse=True), strongest)

    def test_other_descriptors_belong_to_the_features_of_sift(self):
        sift = self.features(self.image)[1]
        for detector in ("gloh", "pca-sift"):
            self.assertEqual(self.features(self.image, "--detector", detector)[1], sift, detector)
        self.assertNotEqual(self.features(self.image, "--detector", "surf-128")[1], sift)
        self.assert_one_line(rilievo("features", self.image, "--detector", "gloss"), "--detector", "gloh", "pca-sift", code=2)

    def test_a_drawing_has_the_size_of_the_image(self):
        drawing = self.scratch / "drawn.png"
        done = rilievo("features", self.image, "--draw", drawing)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(png_size(drawing.read_bytes()), (900, 600))

    def test_a_mask_keeps_what_it_shows_before_the_cut(self):
        mask = self.write("mask.png", png(900, 600, lambda y: bytes([128] * 450 + [127] * 450)))
        free, masked = self.features(self.image)[1], self.features(self.image, "--mask", mask)[1]
        self.assertEqual(masked, [row for row in free if row["x_px"] < 450])
        self.assertGreater(len(masked), 100)
        few = self.features(self.image, "--mask", mask, "--max-features", "50")[1]
        strongest = sorted((row["response"] for row in masked), reverse=True)[:50]
        self.assertEqual(sorted((row["response"] for row in few), reverse=True), strongest)
        black = self.write("black.png", png(900, 600, lambda y: bytes(900)))
        self.assertEqual(self.features(self.image, "--mask", black)[0]["features"], 0)

    def test_masks_that_do_not_fit(self):
        small = self.write("small.png", png(450, 600, lambda y: bytes(450)))
        self.assert_one_line(rilievo("features", self.image, "--mask", small), "small.png", "450 x 600", "900 x 600")
        deep = self.write("deep.png", png(900, 600, lambda y: bytes(1800), bits=16))
        self.assert_one_line(rilievo("features", self.image, "--mask", deep), "deep.png", "16 bits")
        self.assert_one_line(rilievo("features", self.image, "--mask", self.scratch / "absent.png"), "absent.png")
        whole = png(900, 600, noise(900))
        cut = self.write("cut.png", whole[:len(whole) // 2])
        self.assert_one_line(rilievo("features", self.image, "--mask", cut), "cut.png", "truncated")

    def test_images_without_a_feature_are_a_value(self):
        for name, content in (("dot.png", png(1, 1, lambda y: b"\x80")), ("strip.png", png(3, 2000, noise(3))), ("flat.png", png(2000, 2, noise(2000))),
                              ("black.png", png(700, 500, lambda y: bytes(700)))):
            with self.subTest(name):
                summary, rows = self.features(self.write(name, content))
                self.assertEqual((summary["features"], summary["coverage"], rows), (0, 0, []))
                drawn = self.scratch / "drawn.png"
                self.assertEqual(rilievo("features", self.scratch / name, "--draw", drawn).returncode, 0)
                self.assertEqual(png_size(drawn.read_bytes()), (summary["width_px"], summary["height_px"]))

    def test_deep_and_transparent_images(self):
        """The same grey picture as 8 bits, 16 bits, RGB and RGBA has the same features."""
        def grey(x, y):
            return int(128 + 50 * math.sin(0.31 * x) * math.cos(0.23 * y) + 40 * math.sin(0.0007 * x * y))
        rows = [[grey(x, y) for x in range(300)] for y in range(200)]
        forms = {"grey.png": png(300, 200, lambda y: bytes(rows[y])),
                 "deep.png": png(300, 200, lambda y: b"".join(struct.pack(">H", 257 * v) for v in rows[y]), bits=16),
                 "rgb.png": png(300, 200, lambda y: bytes(v for value in rows[y] for v in (value,) * 3), colour=2),
                 "rgba.png": png(300, 200, lambda y: bytes(v for k, value in enumerate(rows[y]) for v in (value, value, value, k % 256)), colour=6)}
        found = {name: self.features(self.write(name, content))[1] for name, content in forms.items()}
        self.assertGreater(len(found["grey.png"]), 20)
        self.assertEqual(found["grey.png"], found["rgb.png"])
        self.assertEqual(found["grey.png"], found["rgba.png"])
        self.assertLess(abs(len(found["deep.png"]) / len(found["grey.png"]) - 1), 0.1)

    def test_bad_files_get_one_line(self):
        jpeg = self.image.read_bytes()
        cmyk = bytearray(jpeg)
        frame = max(jpeg.find(b"\xff\xc0\x00\x0b"), jpeg.find(b"\xff\xc0\x00\x11"))
        self.assertGreater(frame, 0)
        cmyk[frame + 9] = 4
        whole = png(600, 400, noise(600))
        for name, content, words in (("cmyk.jpg", bytes(cmyk), ("CMYK",)),
                                     ("huge.png", whole[:16] + struct.pack(">II", 20000, 20000) + whole[24:2000], ("20000 x 20000",)),
                                     ("giant.png", whole[:16] + struct.pack(">II", 2 ** 30, 2 ** 30) + whole[24:], ("implausible",)),
                                     ("cut.png", whole[:len(whole) // 2], ("truncated",)), ("cut.jpg", jpeg[:len(jpeg) // 2], ("truncated",)),
                                     ("text.jpg", b"no image", ("no JPEG",)), ("empty.png", b"", ("empty",))):
            with self.subTest(name):
                path = self.write(name, content)
                for options in ((), ("--draw", self.scratch / "drawn.png", "--output", self.scratch / "list.csv")):
                    self.assert_one_line(rilievo("features", path, *options), name, *words)
        self.assertFalse((self.scratch / "drawn.png").exists() or (self.scratch / "list.csv").exists())
        self.assert_one_line(rilievo("features", self.scratch / "absent.jpg"), "absent.jpg")
        self.assert_one_line(rilievo("features", self.scratch), self.scratch.name)
        self.assert_one_line(rilievo("features", self.image, "--output", self.scratch / "nowhere" / "a.csv"), "nowhere")

    def test_what_cannot_fit_is_refused(self):
        row = bytes(20000)
        large = self.write("large.png", png(20000, 20000, lambda y: row, level=1))
        self.assert_one_line(rilievo("features", large, "--memory", "300MiB"), "large.png", "--memory")
        self.assert_one_line(rilievo("features", self.image, "--memory", "64MiB"), "--memory")

    def test_usage(self):
        for arguments in ((), (self.image, "--no-such-flag"), (self.image, "--max-features", "0"), (self.image, "--max-features", "many"), (self.image, "--memory", "lots"),
                          (f"{self.scratch}/",), (self.image, self.image)):
            self.assert_one_line(rilievo("features", *arguments), code=2)


if __name__ == "__main__":
    main()
