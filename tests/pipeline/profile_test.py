"""rilievo profile: a workspace keeps the trace of its last run; text, JSON and the page tell the same of it."""
import json
import re
import shutil
import subprocess
import unittest

from rilievo_test import ProgramTest, main, rilievo


class Profile(ProgramTest):
    def setUp(self):
        super().setUp()
        self.workspace = self.scratch / "workspace"

    def profile(self, path=None):
        done = rilievo("profile", path or self.workspace, "--json")
        self.assertEqual(done.returncode, 0, done.stderr)
        return json.loads(done.stdout)

    def test_of_a_run_without_trace_option(self):
        self.assertEqual(self.orient(None, None, None, "--threads", "2").returncode, 0)
        profile = self.profile()
        stages = {stage["name"]: stage for stage in profile["stages"]}
        self.assertEqual((stages["features"]["tasks"], stages["features"]["unit"]), (6, "Mpx"))
        self.assertAlmostEqual(stages["features"]["units"], 6 * 0.54, places=3)
        self.assertEqual((stages["pairs"]["units"], stages["pairs"]["unit"]), (15, "pairs"))
        # Bytes written are those of the artifacts, less their headers of 40 bytes.
        for name in ("features", "pairs", "orientation"):
            files = list((self.workspace / "artifacts" / name).rglob("*.art"))
            on_disk = sum(f.stat().st_size - 40 for f in files)
            if name == "orientation":  # checkpoints of mapping are gone by now
                self.assertGreaterEqual(stages[name]["written_bytes"], on_disk)
            else:
                self.assertEqual(stages[name]["written_bytes"], on_disk, name)
            self.assertGreater(stages[name]["cpu_s"], 0)
            self.assertLessEqual(stages[name]["cpu_s"], 1.1 * stages[name]["worker_s"] + 0.05)
            self.assertGreater(stages[name]["resident_peak_bytes"], 1 << 20)
        self.assertLessEqual(profile["critical_path"]["length_s"], profile["wall_s"] * 1.001)
        self.assertEqual(profile["critical_path"]["tasks"][-1], "orientation")
        self.assertAlmostEqual(profile["worker_s"] + profile["idle_s"], 2 * profile["wall_s"], places=6)
        self.assertLessEqual(profile["memory"]["planned_peak_bytes"], profile["memory"]["allowed_bytes"])
        kernels = {kernel["name"]: kernel for kernel in profile["kernels"]}
        for kernel in kernels.values():
            if kernel["peak_per_s"] is not None:
                self.assertGreater(kernel["share_of_peak"], 0)
                self.assertLess(kernel["share_of_peak"], 1.5)  # the peak is measured beside whatever else runs
        features = [image["features"] for image in self.report()["image_list"]]
        comparisons = sum(a * b for i, a in enumerate(features) for b in features[:i])
        bytes_of = {"m2": 128, "m2 by sketches": 56}  # of each pair one of them
        counted = sum(kernels[name]["multiply_adds"] / n for name, n in bytes_of.items() if name in kernels)
        self.assertAlmostEqual(counted / comparisons, 1, places=6)
        self.assertIn("scale space", kernels)

        text = rilievo("profile", self.workspace)
        self.assertEqual(text.returncode, 0, text.stderr)
        for word in ("features", "Mpx/s", "pairs/s", "critical path", "idle", "m2", "busy"):
            self.assertIn(word, text.stdout)

    def test_the_page_needs_nothing_else(self):
        photos = self.copy_images()
        first = sorted(photos.iterdir())[0]
        first.rename(first.with_name("a <b> & @DATA@ <!--" + first.suffix))
        self.assertEqual(self.orient(photos).returncode, 0)
        page = self.scratch / "run.html"
        done = rilievo("profile", self.workspace, "--html", page)
        self.assertEqual(done.returncode, 0, done.stderr)
        text = page.read_text()
        self.assertNotRegex(text, r"(src|href)\s*=|@import|url\(|https?://|fetch\(|XMLHttp")
        data = json.loads(re.search(r'<script id="data" type="application/json">(.*?)</script>', text, re.S).group(1))
        self.assertTrue(any("a <b>" in task[0] for task in data["spans"]["tasks"]))
        profile = self.profile()
        self.assertEqual(len(data["spans"]["tasks"]), sum(stage["tasks"] for stage in profile["stages"]))
        self.assertTrue(data["curves"]["planned"] and data["curves"]["resident"])
        if shutil.which("node"):  # the script runs, and draws, with a page that only counts
            script = re.search(r"<script>\n(.*?)</script>", text, re.S).group(1)
            harness = self.scratch / "page.js"
            harness.write_text(HARNESS.replace("DATA", json.dumps(json.dumps(data))) + script + "\ncheck();\n")
            ran = subprocess.run(["node", harness], capture_output=True, text=True)
            self.assertEqual(ran.returncode, 0, ran.stderr)
            drawn, tips = map(int, ran.stdout.split())
            self.assertGreaterEqual(drawn, len(data["spans"]["tasks"]))
            self.assertGreater(tips, 0)

    def test_a_run_that_finds_all_done_keeps_the_trace_and_a_new_one_replaces_it(self):
        self.orient()
        trace = self.workspace / "trace.json"
        before = trace.read_bytes()
        self.assertIn("nothing to do", self.orient().stdout)
        self.assertEqual(before, trace.read_bytes())
        self.assertEqual(self.orient(None, None, None, "--ratio", "0.7").returncode, 0)
        stages = {stage["name"]: stage for stage in self.profile()["stages"]}
        self.assertEqual((stages["features"]["reused"], stages["features"]["units"]), (6, 0))
        self.assertEqual(stages["pairs"]["reused"], 0)

    def test_a_trace_file_elsewhere(self):
        trace = self.scratch / "trace.json"
        self.assertEqual(self.orient(None, None, None, "--trace", trace, "--serial").returncode, 0)
        elsewhere, kept = self.profile(trace), self.profile()
        self.assertEqual((elsewhere["threads"], elsewhere["stages"]), (1, kept["stages"]))

    def test_what_cannot_be_profiled(self):
        self.assert_one_line(rilievo("profile", self.scratch / "none"), "none", "trace")
        bad = self.scratch / "bad.json"
        bad.write_text("{")
        self.assert_one_line(rilievo("profile", bad), "bad.json", "damaged")
        self.orient()
        (self.workspace / "trace.json").unlink()
        self.assert_one_line(rilievo("profile", self.workspace), "no trace", "orient")


HARNESS = """
let drawn = 0;
const context = new Proxy({}, {get: (o, k) => k === "fillRect" ? () => { drawn++; } : k in o ? o[k] : () => ({}), set: (o, k, v) => { o[k] = v; return true; }});
const make = () => { const e = {style: {}, classList: {toggle() {}}, cells: [{prepend() {}}], rows: [], listeners: {}, parentElement: {clientWidth: 4000}, offsetWidth: 50, offsetHeight: 50,
  appendChild() {}, prepend() {}, replaceWith() {}, insertRow() { return make(); }, getContext: () => context, addEventListener(kind, f) { this.listeners[kind] = f; }, setPointerCapture() {}}; return e; };
const elements = {data: {textContent: DATA}};
const document = {getElementById: id => elements[id] ??= make(), createElement: make, documentElement: {}};
const window = {addEventListener() {}, devicePixelRatio: 2};
const getComputedStyle = () => ({getPropertyValue: () => "#000"});
function check() {
  const first = drawn, l = elements.view.listeners;
  let tips = 0;
  for (let px = 80; px < 3990; px += 3) { l.pointermove({offsetX: px, offsetY: 30, clientX: px}); if (elements.tip.style.display === "block") tips++; }
  l.wheel({preventDefault() {}, deltaX: 0, deltaY: -300, offsetX: 900});
  l.pointerdown({clientX: 500, pointerId: 1}); l.pointermove({offsetX: 480, offsetY: 30, clientX: 480}); l.pointerup({}); l.dblclick();
  for (const key of ["+", "-", "ArrowLeft", "ArrowRight", "0", "x"]) l.keydown({key, preventDefault() {}});
  console.log(first + " " + tips);
}
"""

if __name__ == "__main__":
    main()
