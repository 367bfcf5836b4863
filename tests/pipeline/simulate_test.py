"""simulate: continues its own block, refuses every other folder; report --truth takes no other scene."""
import json
import pathlib
import shutil
import signal
import subprocess
import time

from rilievo_test import RILIEVO, ProgramTest, main, rilievo


def content(folder):
    """{relative name: (inode, time)}: a file that was written again is another file."""
    return {str(p.relative_to(folder)): (p.stat().st_ino, p.stat().st_mtime_ns) for p in sorted(pathlib.Path(folder).rglob("*")) if p.is_file()}


def changed(options, more):
    """The options with those of `more` in place of their own: the program takes none twice."""
    merged = dict(zip(options[::2], options[1::2]))
    flags = [word for word in more if word in ("--scene-only", "--depth")]
    rest = [word for word in more if word not in flags]
    merged.update(zip(rest[::2], rest[1::2]))
    return [word for pair in merged.items() for word in pair] + flags


class Simulate(ProgramTest):
    block_options = ("--images", "4", "--width-px", "600", "--height-px", "400", "--surface-points", "5000")

    def simulate(self, output=None, *more):
        return rilievo("simulate", *changed(self.block_options, more), "--output", output or self.scratch / "block")

    def copy_block(self):
        target = self.scratch / "block"
        shutil.copytree(self.block, target)
        return target

    def test_the_same_command_again_does_nothing_and_says_so(self):
        before = content(self.block)
        done = self.simulate(self.block)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("nothing to do", done.stdout)
        self.assertEqual(before, content(self.block))

    def test_another_scene_in_the_same_folder_is_refused(self):
        before = content(self.block)
        self.assert_one_line(self.simulate(self.block, "--images", "3"), "--images 4, not 3", "new or empty --output")
        self.assert_one_line(self.simulate(self.block, "--seed", "7"), "--seed 1, not 7")
        self.assert_one_line(self.simulate(self.block, "--seed", "7", "--scene-only"), "--seed 1, not 7")
        self.assertEqual(before, content(self.block))

    def test_foreign_files_are_not_overwritten(self):
        folder = self.scratch / "mine"
        folder.mkdir()
        (folder / "calibration.toml").write_text("mine")
        self.assert_one_line(self.simulate(folder), "mine", "holds other files", "new or empty --output")
        self.assertEqual([p.name for p in folder.iterdir()], ["calibration.toml"])
        block = self.copy_block()
        (block / "calibration.toml").write_text("mine")
        self.assert_one_line(self.simulate(block), "calibration.toml", "move it away")
        self.assertEqual((block / "calibration.toml").read_text(), "mine")
        shutil.copy(self.calibration, block / "calibration.toml")
        (block / "images" / "holiday.jpg").write_text("mine")
        self.assert_one_line(self.simulate(block), "holiday.jpg", "not an image of this scene")
        self.assert_one_line(self.simulate(self.block / "calibration.toml"), "is a file")

    def test_only_what_is_missing_is_made_again(self):
        block = self.copy_block()
        victim = block / "images" / "image_0002.jpg"
        expected = victim.read_bytes()
        victim.unlink()
        before = content(block / "images")
        self.assertEqual(self.simulate(block).returncode, 0)
        self.assertEqual(victim.read_bytes(), expected)
        after = content(block / "images")
        self.assertEqual({name: after[name] for name in before}, before)
        self.assertEqual(self.simulate(block, "--depth").returncode, 0)
        self.assertEqual(len(list((block / "truth" / "depth").iterdir())), 4)
        self.assertEqual(after, content(block / "images"))

    def test_killed_and_continued_it_ends_with_the_same_bytes(self):
        options = ("--images", "8", "--width-px", "1600", "--height-px", "1200", "--surface-points", "5000", "--threads", "1")
        whole, block = self.scratch / "whole", self.scratch / "killed"
        self.assertEqual(rilievo("simulate", *options, "--output", whole).returncode, 0)
        program = subprocess.Popen([RILIEVO, "simulate", *options, "--output", str(block)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            while program.poll() is None and len(list(block.glob("images/*.jpg"))) < 2:
                time.sleep(0.005)
        finally:
            program.send_signal(signal.SIGKILL)
            program.wait()
        images = content(block / "images")
        self.assertTrue(2 <= len(list(block.glob("images/*.jpg"))) < 8, "it was to be killed in the middle")
        self.assertFalse((block / "scene.json").exists(), "scene.json says that the block is whole")
        self.assert_one_line(rilievo("simulate", *options, "--seed", "2", "--output", block), "--seed 1, not 2")
        self.assertEqual(rilievo("simulate", *options, "--output", block).returncode, 0)
        after = content(block / "images")
        kept = {name for name in images if name.endswith(".jpg")}
        self.assertEqual({n: after[n] for n in kept}, {n: images[n] for n in kept}, "finished images are kept")
        files = lambda folder: {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
        self.assertEqual(files(block), files(whole))

    def test_a_scene_alone_becomes_a_block(self):
        block = self.scratch / "block"
        self.assertEqual(self.simulate(block, "--scene-only").returncode, 0)
        self.assertEqual([p.name for p in block.iterdir()], ["scene.json"])
        self.assertEqual(self.simulate(block).returncode, 0)
        self.assertEqual(len(list((block / "images").iterdir())), 4)
        self.assertIn("nothing to do", self.simulate(block).stdout)

    def test_bits_are_8_or_16(self):
        self.assertIn("(8, 16)", rilievo("simulate", "--help").stdout)
        self.assert_one_line(self.simulate(None, "--bits", "12", "--format", "png"), "--bits", "8, 16", code=2)
        self.assert_one_line(self.simulate(None, "--bits", "16"), "--bits", "jpeg", code=2)
        self.assertEqual(list(self.scratch.iterdir()), [])
        self.assertEqual(self.simulate(None, "--bits", "16", "--format", "png").returncode, 0)

    def test_a_ring_with_wide_steps_is_warned_of(self):
        ring = ("--network", "ring", "--surface", "sphere", "--scene-only")
        done = self.simulate(self.scratch / "wide", *ring, "--images", "12")
        self.assertEqual(done.returncode, 0)
        self.assertIn("WARNING: --images 12 puts 30 degrees", done.stderr)
        self.assertIn("use 24 or more", done.stderr)
        self.assertEqual(self.simulate(self.scratch / "close", *ring, "--images", "24").stderr, "")


class Truth(ProgramTest):
    def truth(self, scene, *more):
        return rilievo("report", self.scratch / "workspace", "--truth", scene, *more)

    def scene(self, name, *more):
        done = rilievo("simulate", *changed(self.block_options, more), "--scene-only", "--output", self.scratch / name)
        self.assertEqual(done.returncode, 0, done.stderr)
        return self.scratch / name / "scene.json"

    def test_another_scene_is_refused(self):
        self.assertEqual(self.orient().returncode, 0)
        self.assertEqual(self.truth(self.block / "scene.json").returncode, 0)
        self.assertEqual(self.truth(self.scene("same")).returncode, 0)
        hint = "beside the run's images"
        self.assert_one_line(self.truth(self.scene("names", "--format", "png")), "no image image_0001.jpg", hint)
        self.assert_one_line(self.truth(self.scene("fewer", "--images", "5")), "no image image_0006.jpg", hint)
        self.assert_one_line(self.truth(self.scene("size", "--width-px", "1000"), "--json"), "900 x 600", "1000 x 600", hint)
        self.assert_one_line(self.truth(self.scene("more", "--images", "7")), "belong to", hint)
        self.assert_one_line(self.truth(self.scene("seed", "--seed", "2")), "belong to", hint)

    def test_copied_images_are_compared_by_name_and_size_and_the_result_is_judged(self):
        photos = self.copy_images()
        (photos / "image_0006.jpg").unlink()
        self.assertEqual(self.orient(str(photos) + "/").returncode, 0)
        good = self.truth(self.block / "scene.json", "--json")
        self.assertEqual((good.returncode, good.stderr), (0, ""))
        self.assertEqual(json.loads(good.stdout)["truth"]["images"], 5)
        self.assertIn("does not resemble", self.truth(self.scene("strip", "--network", "random", "--seed", "5")).stderr)

    def test_a_run_from_a_scene_file_knows_its_scene(self):
        self.assertEqual(self.orient(self.block / "scene.json", False).returncode, 0)
        self.assertEqual(self.truth(self.scene("same")).returncode, 0)
        self.assert_one_line(self.truth(self.scene("seed", "--seed", "2")), "made from another scene file")


if __name__ == "__main__":
    main()
