"""Every bad input gets one clear line, or is quarantined while the rest goes on."""
import math
import os
import random
import shutil
import struct
import subprocess
import unittest
import zlib

from rilievo_test import DATA, ProgramTest, main, rilievo


def png(path, width, height, value):
    """Writes a grey PNG; value(x, y) -> 0..255."""
    rows = b"".join(b"\0" + bytes(value(x, y) for x in range(width)) for y in range(height))
    chunk = lambda kind, data: struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))  # noqa: E731
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)) +
                     chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


class BadInput(ProgramTest):
    def test_missing_folder(self):
        self.assert_one_line(self.orient(self.scratch / "nowhere"), "nowhere")

    def test_folder_without_images(self):
        empty = self.scratch / "empty"
        empty.mkdir()
        self.assert_one_line(self.orient(empty), "empty", "image")

    def test_no_readable_image(self):
        folder = self.scratch / "broken"
        folder.mkdir()
        for k in range(3):
            (folder / f"{k}.jpg").write_bytes(b"no image")
        self.assert_one_line(self.orient(folder), "no readable image")

    def quarantines(self, name, content):
        photos = self.copy_images()
        (photos / name).write_bytes(content)
        done = self.orient(photos)
        self.assertEqual(done.returncode, 0, done.stderr)
        report = self.report()
        self.assertEqual(report["oriented"], 6)
        self.assertEqual([q["name"] for q in report["quarantined"]], [name], report["quarantined"])
        self.assertIn(name, (self.scratch / "workspace" / "report.txt").read_text())

    def test_a_zero_byte_file_among_good_ones(self):
        self.quarantines("zero.jpg", b"")

    def test_a_text_file_named_jpg_among_good_ones(self):
        self.quarantines("text.jpg", b"hello, I am no photograph\n" * 100)

    def test_a_truncated_image_among_good_ones(self):
        good = sorted(self.images.iterdir())[0].read_bytes()
        self.quarantines("truncated" + sorted(self.images.iterdir())[0].suffix, good[: len(good) * 2 // 3])

    def test_a_corrupt_image_among_good_ones(self):
        first = sorted(self.images.iterdir())[0]
        content = bytearray(first.read_bytes())
        draw = random.Random(4)
        for _ in range(3000):
            content[draw.randrange(len(content) // 4, len(content) - 2)] = 0
        photos = self.copy_images()
        (photos / ("zcorrupt" + first.suffix)).write_bytes(content)
        done = self.orient(photos)
        self.assertEqual(done.returncode, 0, done.stderr)
        report = self.report()
        damaged = "zcorrupt" + first.suffix
        images = {image["name"]: image for image in report["models"][0]["images"]}
        good = {path.name for path in self.images.iterdir()}
        self.assertLessEqual(good, set(images), "a damaged image costs a good one its orientation")
        left_out = [entry["name"] for kind in ("quarantined", "unoriented") for entry in report[kind]]
        if damaged not in images:
            self.assertEqual(left_out, [damaged])
        else:  # the decoder may make sense of it: then it stands where the image stands that it was made from
            self.assertEqual(left_out, [])
            self.assertLess(math.dist(images[damaged]["center"], images[first.name]["center"]), 0.05)
            self.assertLess(images[damaged]["rms_x_px"], 2)

    def test_wrong_calibration_size(self):
        text = self.calibration.read_text().replace("width_px = 900", "width_px = 4000")
        wrong = self.scratch / "wrong.toml"
        wrong.write_text(text)
        self.assert_one_line(self.orient(None, wrong), "900", "4000")

    def test_calibration_of_another_format(self):
        for k, content in enumerate((b"<?xml version='1.0'?><document><chunk/></document>", b"\xff\xd8\xff\xe0 jpeg", b"fx fy cx cy\n1 2 3 4\n", b"")):
            other = self.scratch / f"other{k}.xml"
            other.write_bytes(content)
            self.assert_one_line(self.orient(None, other), f"other{k}.xml")
        self.assert_one_line(self.orient(None, self.scratch / "absent.txt"), "absent.txt")

    def test_a_single_image(self):
        photos = self.scratch / "one"
        photos.mkdir()
        shutil.copy(sorted(self.images.iterdir())[0], photos)
        self.assert_one_line(self.orient(photos), "at least two")

    def test_two_identical_images(self):
        photos = self.scratch / "twins"
        photos.mkdir()
        first = sorted(self.images.iterdir())[0]
        shutil.copy(first, photos / ("a" + first.suffix))
        shutil.copy(first, photos / ("b" + first.suffix))
        self.assert_one_line(self.orient(photos), "one usable image", "a" + first.suffix)

    def test_the_same_pixels_twice_in_other_files(self):
        """Files that differ in a byte of their EXIF text only: no parallax, so nothing can be oriented."""
        photos = self.scratch / "twins"
        photos.mkdir()
        content = sorted(self.images.iterdir())[0].read_bytes()
        self.assertIn(b"Rilievo", content)
        (photos / "a.jpg").write_bytes(content)
        (photos / "b.jpg").write_bytes(content.replace(b"Rilievo", b"Rilieva", 1))
        self.assert_one_line(self.orient(photos), "no image could be oriented")

    def test_a_copy_of_a_photograph_counts_once(self):
        photos = self.copy_images()
        (photos / "backup").mkdir()
        first = sorted(self.images.iterdir())[0]
        shutil.copy(first, photos / "backup")
        self.assertEqual(self.orient(photos).returncode, 0)
        report = self.report()
        self.assertEqual(report["oriented"], 6)
        self.assertEqual(len(report["quarantined"]), 1)

    def test_textureless_images(self):
        photos = self.scratch / "flat"
        photos.mkdir()
        for k in range(3):
            png(photos / f"{k}.png", 900, 600, lambda x, y, grey=120 + k: grey)
        self.assert_one_line(self.orient(photos), "no image could be oriented")

    def test_disconnected_scenes_give_several_models(self):
        other = self.scratch / "other"
        self.assertEqual(rilievo("simulate", *self.block_options, "--seed", "77", "--output", other).returncode, 0)
        photos = self.scratch / "both"
        shutil.copytree(self.images, photos / "a")
        shutil.copytree(other / "images", photos / "b")
        done = self.orient(photos)
        self.assertEqual(done.returncode, 0, done.stderr)
        report = self.report()
        self.assertEqual(report["oriented"], 12)
        self.assertEqual([len(m["images"]) for m in report["models"]], [6, 6])
        for model in report["models"]:
            self.assertEqual(len({image["name"].split("/")[0] for image in model["images"]}), 1)

    def test_memory_too_small(self):
        self.assert_one_line(self.orient(None, None, None, "--memory", "64MiB"), "--memory")
        self.assert_one_line(self.orient(None, None, None, "--memory", "165MiB"), "--memory")
        self.assert_one_line(self.orient(None, None, None, "--memory", "lots"), "memory", code=2)

    def test_usage(self):
        self.assert_one_line(rilievo("orient"), code=2)
        self.assert_one_line(rilievo("orient", self.images, "--workspace", self.scratch / "w", "--no-such-flag"), "no-such-flag", code=2)
        self.assert_one_line(self.orient(None, None, None, "--ratio", "7"), "ratio", code=2)
        self.assert_one_line(self.orient(None, None, None, "--ratio", "abc"), "ratio", code=2)
        self.assert_one_line(rilievo("report", self.scratch / "nothing"), "nothing")
        self.assert_one_line(rilievo("export", self.scratch, "--format", "ply", "--output", self.scratch / "o"), "run.json")

    def test_workspace_that_is_something_else(self):
        self.assert_one_line(self.orient(None, None, self.images), "no workspace")
        self.assert_one_line(self.orient(None, None, self.calibration), "file")

    def unprivileged(self):
        """A command prefix that runs as an ordinary user, who a read-only folder stops."""
        if os.geteuid() != 0:
            return []
        if not shutil.which("setpriv"):
            raise unittest.SkipTest("setpriv is not installed")
        return ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"]

    def test_a_read_only_folder(self):
        prefix = self.unprivileged()
        for folder in (self.class_scratch, self.scratch):
            os.chmod(folder, 0o755)
        place = self.scratch / "readonly"
        place.mkdir()
        os.chmod(place, 0o555)
        command = [*prefix, os.environ.get("RILIEVO", "rilievo"), "orient", str(self.images), "--calibration", str(self.calibration), "--workspace", str(place / "w")]
        done = subprocess.run(command, capture_output=True, text=True, timeout=300)
        if "setpriv" in done.stderr:
            raise unittest.SkipTest("setpriv cannot change the user here")
        self.assert_one_line(done, place)

    def test_a_full_disk(self):
        """A tiny file system of its own where that is permitted: the run is refused before it starts."""
        place = self.scratch / "tiny"
        place.mkdir()
        mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(place)], capture_output=True)
        if mounted.returncode != 0:
            raise unittest.SkipTest("mounting a tmpfs is not permitted here")
        try:
            self.assert_one_line(self.orient(None, None, place / "w"), "disk", "free")
        finally:
            subprocess.run(["umount", "-l", str(place)], check=False)

    def test_a_write_that_fails_during_the_run(self):
        """A limit on file size stands for the full disk: the write fails, one line, and with space the run goes on."""
        limited = f"ulimit -f 40; exec '{os.environ.get('RILIEVO', 'rilievo')}' orient '{self.images}' --calibration '{self.calibration}' --workspace '{self.scratch}/workspace'"
        done = subprocess.run(["bash", "-c", limited], capture_output=True, text=True, timeout=600)
        self.assert_one_line(done, "cannot be written", "limit")
        self.assertEqual(self.orient().returncode, 0)
        self.assertEqual(self.report()["oriented"], 6)


class RealPhotographs(unittest.TestCase):
    def test_portrait_and_landscape_by_size(self):
        folder = DATA / "cyprus10"
        if not (folder / "images").is_dir():
            raise unittest.SkipTest(f"{folder.name} is absent")
        done = rilievo("plan", folder / "images", "--calibration", folder / "cameras.txt")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("2 cameras", done.stdout)


if __name__ == "__main__":
    main()
