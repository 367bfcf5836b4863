"""What photographs come as: formats, sample depths, colour, EXIF orientation, several cameras, and no calibration at all."""
import re
import shutil
import struct
import zlib

from rilievo_test import ProgramTest, main, rilievo


def exif_segment(jpeg):
    """(start, end) of the APP1 EXIF segment, marker included."""
    at = 2
    while jpeg[at + 1] != 0xDA:
        end = at + 2 + struct.unpack(">H", jpeg[at + 2:at + 4])[0]
        if jpeg[at + 1] == 0xE1 and jpeg[at + 4:at + 10] == b"Exif\0\0":
            return at, end
        at = end
    raise AssertionError("the image has no EXIF")


def with_orientation(jpeg, orientation):
    """The same JPEG whose EXIF orientation is another."""
    start, _ = exif_segment(jpeg)
    tiff = start + 10
    order = {b"II": "<", b"MM": ">"}[jpeg[tiff:tiff + 2]]
    ifd = tiff + struct.unpack(order + "I", jpeg[tiff + 4:tiff + 8])[0]
    for k in range(struct.unpack(order + "H", jpeg[ifd:ifd + 2])[0]):
        entry = ifd + 2 + 12 * k
        if struct.unpack(order + "H", jpeg[entry:entry + 2])[0] == 0x0112:
            return jpeg[:entry + 8] + struct.pack(order + "H", orientation) + jpeg[entry + 10:]
    raise AssertionError("the EXIF has no orientation")


def png_chunks(content):
    at = 8
    while at < len(content):
        length = struct.unpack(">I", content[at:at + 4])[0]
        yield content[at + 4:at + 8], content[at + 8:at + 8 + length]
        at += 12 + length


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def grey_rows(content):
    """(width, rows of bytes) of an 8-bit grey PNG that is not interlaced (PNG specification, section 9: filters)."""
    chunks = list(png_chunks(content))
    width, height, bits, colour, _, _, interlaced = struct.unpack(">IIBBBBB", dict(chunks)[b"IHDR"])
    assert (bits, colour, interlaced) == (8, 0, 0), (bits, colour, interlaced)
    data = zlib.decompress(b"".join(d for kind, d in chunks if kind == b"IDAT"))
    above, rows = bytes(width), []
    for y in range(height):
        kind, line = data[y * (width + 1)], bytearray(data[y * (width + 1) + 1:(y + 1) * (width + 1)])
        for x in range(width):
            left, upper_left = (line[x - 1], above[x - 1]) if x else (0, 0)
            if kind == 1:
                guess = left
            elif kind == 2:
                guess = above[x]
            elif kind == 3:
                guess = (left + above[x]) // 2
            elif kind == 4:
                p = left + above[x] - upper_left
                guess = min((abs(p - left), 0, left), (abs(p - above[x]), 1, above[x]), (abs(p - upper_left), 2, upper_left))[2]
            else:
                guess = 0
            line[x] = (line[x] + guess) & 255
        above = bytes(line)
        rows.append(above)
    return width, rows


def in_colour(content):
    """The same PNG with three equal channels."""
    width, rows = grey_rows(content)
    data = b"".join(b"\0" + bytes(v for value in row for v in (value, value, value)) for row in rows)
    return content[:8] + chunk(b"IHDR", struct.pack(">IIBBBBB", width, len(rows), 8, 2, 0, 0, 0)) + chunk(b"IDAT", zlib.compress(data, 1)) + chunk(b"IEND", b"")


class ImageKinds(ProgramTest):
    def simulate(self, name, *options, size=("900", "600")):
        done = rilievo("simulate", "--images", "6", "--width-px", size[0], "--height-px", size[1], *options, "--output", self.scratch / name)
        self.assertEqual(done.returncode, 0, done.stderr)
        return self.scratch / name

    def all_oriented(self, images, calibration, *options, name="workspace"):
        done = self.orient(images, calibration, self.scratch / name, *options)
        self.assertEqual(done.returncode, 0, done.stderr)
        report = self.report(self.scratch / name)
        self.assertEqual((report["oriented"], len(report["models"]), report["quarantined"]), (6, 1, []))
        return report

    def test_png_and_16_bit_tiff_give_what_jpeg_gives(self):
        jpeg = self.all_oriented(self.images, self.calibration, name="jpeg")
        for form, bits in (("png", "8"), ("png", "16"), ("tif", "8"), ("tif", "16")):
            with self.subTest(form=form, bits=bits):
                block = self.simulate(f"{form}{bits}", "--format", form, "--bits", bits)
                report = self.all_oriented(block / "images", block / "calibration.toml", name=f"w-{form}{bits}")
                self.assertLess(abs(report["features"] / jpeg["features"] - 1), 0.2)
                self.assertLess(report["models"][0]["sigma0_px"], 1.2 * jpeg["models"][0]["sigma0_px"])

    def test_grey_and_colour_in_one_block(self):
        block = self.simulate("png", "--format", "png")
        grey = self.all_oriented(block / "images", block / "calibration.toml", name="grey")
        victim = sorted((block / "images").iterdir())[2]
        victim.write_bytes(in_colour(victim.read_bytes()))
        mixed = self.all_oriented(block / "images", block / "calibration.toml", name="mixed")
        before, after = (next(i["features"] for i in report["image_list"] if i["name"] == victim.name) for report in (grey, mixed))
        self.assertLess(abs(after / before - 1), 0.02, "equal channels are the same grey image")

    def test_pixels_are_used_as_stored_whatever_exif_says_of_orientation(self):
        def figures(report):
            return ([(image["name"], image["width_px"], image["height_px"], image["features"]) for image in report["image_list"]],
                    {image["name"]: image["center"] for image in report["models"][0]["images"]})

        features, centers = figures(self.all_oriented(self.images, self.calibration, name="upright"))
        for orientation in (6, 8):
            photos = self.copy_images(f"photos-{orientation}")
            for path in photos.iterdir():
                path.write_bytes(with_orientation(path.read_bytes(), orientation))
            turned_features, turned_centers = figures(self.all_oriented(photos, self.calibration, name=f"turned-{orientation}"))
            self.assertEqual(features, turned_features)
            self.assertEqual(centers, turned_centers)

    def two_cameras(self, *second_options, **keywords):
        """Images 1 to 3 of one camera in left/, 4 to 6 of another at the same object in right/; returns (folder, the other block)."""
        other = self.simulate("other", *second_options, **keywords)
        photos = self.scratch / "photos"
        for side, block, chosen in (("left", self.block, slice(0, 3)), ("right", other, slice(3, 6))):
            (photos / side).mkdir(parents=True)
            for path in sorted((block / "images").iterdir())[chosen]:
                shutil.copy(path, photos / side)
        return photos, other

    def test_a_calibration_for_each_folder(self):
        photos, other = self.two_cameras("--focal-px", "1250")
        entries = [block.joinpath("calibration.toml").read_text().split("[[camera]]")[1] for block in (self.block, other)]

        def orient(sides, name):
            path = self.scratch / f"{name}.toml"
            path.write_text('format = "rilievo-calibration"\nversion = 1\n' +
                            "".join(f'\n[[camera]]\nfolder = "{side}"{entry}' for side, entry in zip(sides, entries)))
            return self.orient(photos, path, self.scratch / name)

        done = orient(("left", "right"), "right-way")
        self.assertEqual(done.returncode, 0, done.stderr)
        report = self.report(self.scratch / "right-way")
        self.assertEqual((report["oriented"], len(report["models"])), (6, 1))
        self.assertEqual(sorted(round(camera["fx_px"]) for camera in report["cameras"]), [990, 1250])
        fx = {image["name"]: round(report["cameras"][image["camera"]]["fx_px"]) for image in report["image_list"]}
        self.assertEqual({name.split("/")[0]: value for name, value in fx.items()}, {"left": 990, "right": 1250})
        self.assertLess(report["models"][0]["sigma0_px"], 0.5)
        done = orient(("right", "left"), "wrong-way")
        wrong = self.report(self.scratch / "wrong-way") if done.returncode == 0 else {"oriented": 0, "models": []}
        self.assertTrue(wrong["oriented"] < 6 or wrong["models"][0]["points"] < 0.9 * report["models"][0]["points"] or
                        wrong["models"][0]["sigma0_px"] > 1.5 * report["models"][0]["sigma0_px"], "exchanged calibrations must show")

    def test_two_image_sizes_by_cameras_txt(self):
        photos, other = self.two_cameras(size=("750", "500"))
        lines = []
        for k, block in enumerate((self.block, other)):
            value = dict(re.findall(r"(\w+) = ([-\d.e]+)$", block.joinpath("calibration.toml").read_text(), re.M))
            lines.append(" ".join([str(k + 1), "OPENCV", value["width_px"], value["height_px"]] +
                                  [value[n] for n in ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2")]))
        cameras = self.scratch / "cameras.txt"
        cameras.write_text("# Camera list\n" + "\n".join(lines) + "\n")
        report = self.all_oriented(photos, cameras)
        self.assertEqual(sorted(camera["width_px"] for camera in report["cameras"]), [750, 900])
        self.assertLess(report["models"][0]["sigma0_px"], 0.5)

    def test_without_calibration_exif_gives_the_focal_length_loudly(self):
        done = self.orient(None, False)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("WARNING", done.stderr)
        self.assertIn("EXIF", done.stderr)
        report = self.report()
        self.assertEqual(report["oriented"], 6)
        self.assertLess(abs(report["cameras"][0]["fx_px"] / 990 - 1), 0.01)
        self.assertTrue(report["warnings"])

    def test_without_calibration_and_without_exif_the_guess_is_said_loudly(self):
        photos = self.copy_images()
        for path in photos.iterdir():
            jpeg = path.read_bytes()
            start, end = exif_segment(jpeg)
            path.write_bytes(jpeg[:start] + jpeg[end:])
        done = self.orient(photos, False)
        self.assertEqual(done.returncode, 0, done.stderr)  # 9 % wrong is good enough for an orientation, and the user is told
        self.assertIn("WARNING", done.stderr)
        self.assertIn("guess", done.stderr.lower())
        self.assertIn("--calibration", done.stderr)
        report = self.report()
        self.assertEqual(report["oriented"], 6)
        self.assertTrue(report["warnings"])


if __name__ == "__main__":
    main()
