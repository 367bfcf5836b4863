"""Simulated blocks, rendered once and kept, and runs on them. Standard library only."""
import json
import os
import pathlib
import shutil
import tempfile

from program import files_of, run

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
FORMATS = ("colmap-text", "colmap-binary", "bundler", "ply")


def last_line(text):
    return text.strip().splitlines()[-1] if text.strip() else ""


def cache_folder():
    """RILIEVO_BENCH_CACHE, or a folder beside the build: rendering takes longer than many a figure."""
    return pathlib.Path(os.environ.get("RILIEVO_BENCH_CACHE", ROOT / "build" / "bench-blocks")).resolve()


class Block:
    def __init__(self, folder):
        self.images, self.calibration, self.scene = folder / "images", folder / "calibration.toml", folder / "scene.json"


class Runs:
    """Runs the program in workspaces below a scratch folder, which goes at the end."""

    def __init__(self, binaries):
        self.binaries, self.rilievo = binaries, binaries / "rilievo"
        self.scratch = pathlib.Path(tempfile.mkdtemp(prefix="rilievo-bench-"))

    def close(self):
        shutil.rmtree(self.scratch, ignore_errors=True)

    def block(self, name, *options):
        """A simulated block, rendered unless it is in the cache: `simulate` continues there, and refuses another scene."""
        folder = cache_folder() / name
        done = run([self.rilievo, "simulate", *options, "--output", folder, "--quiet"])
        if done.code != 0:
            raise RuntimeError(f"simulate {name} ended with {done.code}: {last_line(done.err)} (remove {folder} when its options have changed)")
        return Block(folder)

    def orient(self, name, block, *options, images=None, **limits):
        """(workspace, run) in the workspace of that name, which may be there already."""
        workspace = self.scratch / name
        command = [self.rilievo, "orient", images or block.images, "--calibration", block.calibration, "--workspace", workspace, "--progress", "quiet", *options]
        return workspace, run(command, **limits)

    def must_orient(self, name, block, *options, **keywords):
        workspace, done = self.orient(name, block, *options, **keywords)
        if done.code != 0:
            raise RuntimeError(f"{name}: exit code {done.code}: {last_line(done.err)}")
        return workspace, done

    def export(self, workspace, formats=FORMATS):
        """{format/file: bytes}; empty when there is nothing to export."""
        files = {}
        for form in formats:
            output = self.scratch / f"{workspace.name}-{form}"
            shutil.rmtree(output, ignore_errors=True)
            if run([self.rilievo, "export", workspace, "--format", form, "--output", output]).code == 0:
                files.update({f"{form}/{name}": content for name, content in files_of(output).items()})
            shutil.rmtree(output, ignore_errors=True)
        return files

    def report(self, workspace, *options):
        done = run([self.rilievo, "report", workspace, "--json", *options])
        return json.loads(done.out) if done.code == 0 else None

    def drop(self, workspace):
        shutil.rmtree(workspace, ignore_errors=True)
