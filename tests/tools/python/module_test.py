"""The Python module: module_test.py PROGRAM FOLDER, that of its sources."""
import ast
import re
import subprocess
import sys
import tempfile
import types
import unittest
import warnings
from unittest import mock
from pathlib import Path

import numpy as np

import lamina

PROGRAM, SOURCES = sys.argv[1:3]
SCANS = 20


def room_scan(x):
    """What a sensor at x sees of a room of 12 x 8 x 3 m."""
    azimuth, elevation = np.meshgrid(np.radians(np.arange(360)), 0.04 * np.arange(-8, 9))
    azimuth = azimuth + 0.25 * elevation
    d = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth),
                  np.sin(elevation)], -1).reshape(-1, 3)
    half = np.where(d > 0, np.array([6.0 - x, 4.0, 1.5]), np.array([6.0 + x, 4.0, 1.5]))
    with np.errstate(divide="ignore"):
        return d * np.min(half / np.abs(d), axis=1, keepdims=True)


def add_all(mapping, dtype=np.float32):
    return [mapping.add(room_scan(0.1 * i).astype(dtype), 100_000_000 * i) for i in range(SCANS)]


def rotation(axis, angle):
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def pose(R, t):
    return np.block([[R, np.reshape(t, (3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]])


def some_drive(count, random):
    """A way of 0.8 m a pose through all directions, and an estimate that drifts from it."""
    truth, estimate = [np.eye(4)], [pose(rotation(np.array([1, 2, 3.0]), 0.7), [5, -3, 2])]
    for _ in range(count - 1):
        step = pose(rotation(random.normal(size=3), 0.05), [0.8, 0.02, 0.01])
        error = pose(rotation(random.normal(size=3), 0.002), random.normal(size=3) * 0.01)
        truth.append(truth[-1] @ step)
        estimate.append(estimate[-1] @ step @ error)
    return np.array(truth), np.array(estimate)


def aligned(estimate, truth):
    """Estimate moved onto the truth by the least squares of its positions (Horn 1987, by SVD)."""
    a, b = estimate[:, :3, 3], truth[:, :3, 3]
    u, _, vt = np.linalg.svd((b - b.mean(0)).T @ (a - a.mean(0)))
    R = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    return pose(R, b.mean(0) - R @ a.mean(0)) @ estimate


def errors_of(estimate, truth):
    """What lamina.evaluate tells, from the definitions and with NumPy alone."""
    apart = np.linalg.norm(aligned(estimate, truth)[:, :3, 3] - truth[:, :3, 3], axis=1)
    inverse = np.linalg.inv
    relative = [inverse(inverse(t0) @ t1) @ (inverse(e0) @ e1) for t0, t1, e0, e1 in
                zip(truth[:-1], truth[1:], estimate[:-1], estimate[1:])]
    angles = [np.arccos(np.clip((np.trace(E[:3, :3]) - 1) / 2, -1, 1)) for E in relative]
    way = np.r_[0, np.cumsum(np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1))]
    segments = {}
    for length in (5.0, 10.0, 20.0, 50.0):
        found = []
        for i in range(len(truth)):
            j = np.searchsorted(way, way[i] + length)
            if j < len(truth):
                E = inverse(inverse(truth[i]) @ truth[j]) @ (inverse(estimate[i]) @ estimate[j])
                found.append(100 * np.linalg.norm(E[:3, 3]) / length)
        segments[length] = np.mean(found)
    return {"poses": len(truth), "length_m": way[-1],
            "ape_rmse_m": np.sqrt(np.mean(apart ** 2)), "ape_max_m": apart.max(),
            "rpe_rmse_m": np.sqrt(np.mean([E[:3, 3] @ E[:3, 3] for E in relative])),
            "rpe_rmse_deg": np.degrees(np.sqrt(np.mean(np.square(angles))))}, segments


class Drawing(types.ModuleType):
    """In the place of matplotlib.pyplot where that is not installed: keeps what is drawn."""

    def __init__(self):
        super().__init__("matplotlib.pyplot")
        self.calls = []

    def __getattr__(self, name):
        if name.startswith("__"):
            raise AttributeError(name)
        return lambda *args, **options: self.calls.append((name, args))


class ModuleTest(unittest.TestCase):
    def test_maps_arrays(self):
        mapping = lamina.Mapping()
        mapped = add_all(mapping)
        self.assertEqual(mapped[0].status, "first")
        self.assertEqual({m.status for m in mapped[1:]}, {"tracked"})
        self.assertEqual(mapped[-1].pose.shape, (4, 4))
        self.assertAlmostEqual(mapped[-1].pose[0, 3], 1.9, delta=0.01)
        self.assertEqual(mapped[-1].covariance.shape, (6, 6))
        self.assertTrue((np.linalg.eigvalsh(mapped[-1].covariance) > 0).all())
        mapping.finish()
        mapping.finish()
        trajectory = mapping.trajectory()
        self.assertEqual(len(trajectory), SCANS)
        self.assertEqual(trajectory.poses.shape, (SCANS, 4, 4))
        np.testing.assert_array_equal(trajectory.stamps_ns, 100_000_000 * np.arange(SCANS))
        self.assertFalse(trajectory.skipped.any())
        truth = np.tile(np.eye(4), (SCANS, 1, 1))
        truth[:, 0, 3] = 0.1 * np.arange(SCANS)
        self.assertLess(lamina.evaluate(trajectory.poses, truth, "first")["ape_max_m"], 0.01)
        planes = mapping.surfels()
        self.assertGreater(len(planes["centre"]), 20)
        np.testing.assert_allclose(np.linalg.norm(planes["normal"], axis=1), 1.0, atol=1e-5)
        self.assertEqual(mapping.counts["frames"], SCANS)

    def test_poses_are_there_before_the_end(self):
        mapping = lamina.Mapping()
        add_all(mapping)
        self.assertEqual(len(mapping.trajectory()), SCANS)

    def test_doubles_and_intensity_give_the_same(self):
        poses = []
        for convert in (lambda p: p, lambda p: p.astype(np.float64), lambda p: np.asfortranarray(p),
                        lambda p: np.c_[p, np.ones(len(p), np.float32)]):
            mapping = lamina.Mapping()
            for i in range(SCANS):
                mapping.add(convert(room_scan(0.1 * i).astype(np.float32)), 100_000_000 * i)
            mapping.finish()
            poses.append(mapping.trajectory().poses)
        for other in poses[1:]:
            np.testing.assert_array_equal(poses[0], other)

    def test_bad_scans_are_skipped_and_bad_arrays_refused(self):
        mapping = lamina.Mapping()
        add_all(mapping)
        skipped = mapping.add(np.full((500, 3), np.nan), 100_000_000 * SCANS)
        self.assertTrue(skipped.skipped)
        self.assertEqual(skipped.status, "too_few_points")
        self.assertTrue(mapping.add(np.empty((0, 3)), 100_000_000 * SCANS).skipped)
        for points in (np.zeros(3), np.zeros((10, 2)), np.zeros((2, 3, 4))):
            with self.assertRaisesRegex(lamina.InputError, "shape"):
                mapping.add(points)
        with self.assertRaisesRegex(lamina.InputError, "times"):
            mapping.add(np.zeros((10, 3)), times=np.zeros(9))
        self.assertEqual(len(mapping.trajectory()), SCANS + 2)

    def test_options_are_checked(self):
        lamina.Mapping("kitti_raw", {"map.depth": 2, "backend.enabled": False})
        for options in ({"map.depht": 2}, {"map.depth": 20}, {"map.depth": "two"}):
            with self.assertRaisesRegex(lamina.OptionError, "map.dep"):
                lamina.Mapping(options=options)
        with self.assertRaisesRegex(ValueError, "there is no configuration"):
            lamina.Mapping("kitti_row")

    def test_recordings_are_read_and_mapped_as_the_program_does(self):
        with tempfile.TemporaryDirectory() as folder:
            scans, out = Path(folder) / "scans", Path(folder) / "out"
            subprocess.run([PROGRAM, "synth", "--out", scans, "--scene", "street", "--sensor", "vlp16",
                            "--frames", "12"], check=True, capture_output=True)
            subprocess.run([PROGRAM, "run", "--scans", scans, "--out", out, "--progress", "off"],
                           check=True, capture_output=True)
            recording = lamina.Recording(scans)
            self.assertEqual(len(recording), 12)
            self.assertEqual(recording[-1].stamp_ns, recording[11].stamp_ns)
            self.assertEqual(recording[0].points.shape[1], 4)
            self.assertIsNone(recording[0].times)
            self.assertTrue(recording.name(3).endswith("000003.bin"))
            with self.assertRaises(IndexError):
                recording[12]
            ahead, one_by_one = lamina.Mapping(), lamina.Mapping()
            ahead.add_recording(recording)
            for scan in recording:
                one_by_one.add(scan.points, scan.stamp_ns, scan.times)
            ahead.finish()
            one_by_one.finish()
            np.testing.assert_array_equal(ahead.trajectory().poses, one_by_one.trajectory().poses)
            program = lamina.read_trajectory(str(out / "trajectory_kitti.txt")).poses
            np.testing.assert_allclose(ahead.trajectory().poses, program, atol=1e-8)
            truth = lamina.read_trajectory(scans / "poses.txt").poses
            errors = lamina.evaluate(program, truth)
            self.assertLess(errors["ape_rmse_m"], 0.02)
            self.assertEqual(errors["poses"], 12)
            with self.assertRaises(lamina.InputError):
                lamina.evaluate(program[:5], truth)
            with self.assertRaisesRegex(lamina.InputError, "is no pose"):
                lamina.evaluate(2.0 * program, truth)
        with self.assertRaisesRegex(lamina.InputError, "not/there"):
            lamina.Recording("not/there")

    def test_errors_are_those_of_their_definitions(self):
        for seed in range(3):
            truth, estimate = some_drive(120, np.random.default_rng(seed))
            told, (expected, segments) = lamina.evaluate(estimate, truth), errors_of(estimate, truth)
            for name, value in expected.items():
                self.assertAlmostEqual(told[name] / value, 1.0, places=6, msg=name)
            self.assertEqual(set(told["short_segments_percent"]), set(segments))
            for length, percent in segments.items():
                self.assertAlmostEqual(told["short_segments_percent"][length], percent, places=6)

    def test_examples_of_pages_run_as_they_are_printed(self):
        modules = {}
        try:
            import matplotlib.pyplot as plt
            plt.switch_backend("Agg")
        except ImportError:
            plt, package = Drawing(), types.ModuleType("matplotlib")
            package.pyplot = plt
            modules = {"matplotlib": package, "matplotlib.pyplot": plt}
        with tempfile.TemporaryDirectory() as folder:
            kitti = Path(folder) / "data/kitti"
            scans = kitti / "sequences/07"
            subprocess.run([PROGRAM, "synth", "--out", scans, "--scene", "street", "--sensor", "vlp16",
                            "--frames", "12"], check=True, capture_output=True)
            (kitti / "poses").mkdir()
            (scans / "poses.txt").rename(kitti / "poses/07.txt")
            truth = lamina.read_trajectory(str(kitti / "poses/07.txt")).poses
            for page, lines in (("../../README.md", 20), ("README.md", 22)):
                text = (Path(SOURCES) / page).read_text()
                code = re.search(r"```python\n(.*?)```", text, re.S)[1]
                self.assertIn('"/data/kitti/', code)
                self.assertLessEqual(len(code.splitlines()), lines)
                shown = {}
                with mock.patch.dict(sys.modules, modules), mock.patch("builtins.print") as said, \
                        warnings.catch_warnings():
                    warnings.simplefilter("ignore")  # nobody sees what Agg shows
                    exec(code.replace("/data/kitti", str(kitti)), shown)
                self.assertEqual(shown["poses"].shape, (12, 4, 4))
                np.testing.assert_allclose(shown["poses"][:, :3, 3], truth[:, :3, 3], atol=0.05)
                if "evaluate" in code:
                    self.assertLess(said.call_args.args[0], 0.05)  # the error, in metres
                else:
                    said.assert_not_called()
                if "pyplot" not in code:
                    continue
                if isinstance(plt, Drawing):
                    self.assertEqual((plt.calls[0][0], plt.calls[-1][0]), ("plot", "show"))
                    continue
                drawn = plt.gca().lines[0].get_xydata()
                np.testing.assert_allclose(drawn, shown["poses"][:, :2, 3])
                plt.close("all")

    def test_it_is_a_package_with_types(self):
        for name in ("__init__.pyi", "py.typed"):
            self.assertTrue((Path(lamina.__file__).parent / name).is_file(), name)

    def test_everything_is_typed(self):
        tree = ast.parse((Path(SOURCES) / "lamina.pyi").read_text())
        told = {}
        for node in tree.body:
            if isinstance(node, ast.ClassDef):
                told[node.name] = {n.name for n in node.body if isinstance(n, ast.FunctionDef)}
            elif isinstance(node, ast.FunctionDef):
                told[node.name] = set()
        for name in (n for n in dir(lamina) if not n.startswith("_")):
            self.assertIn(name, told)
            thing = getattr(lamina, name)
            if isinstance(thing, type) and not issubclass(thing, Exception):
                members = {n for n in vars(thing) if not n.startswith("_")}
                self.assertEqual(members, {n for n in told[name] if not n.startswith("_")}, name)

    def test_help_tells_what_things_are(self):
        self.assertIn("p_world = T @ p_lidar", lamina.__doc__)
        for name in (n for n in dir(lamina) if not n.startswith("_")):
            thing = getattr(lamina, name)
            described = {name: thing}
            if isinstance(thing, type) and not issubclass(thing, Exception):
                described.update((f"{name}.{n}", member) for n, member in vars(thing).items()
                                 if not n.startswith("_"))
            for what, member in described.items():
                # Of functions behind their signature.
                text = re.sub(r"^\w+\(.*\) -> .*$", "", member.__doc__ or "", flags=re.M)
                self.assertRegex(text, r"\w.* .*\w", what)
                self.assertNotIn("::", member.__doc__, what)
        self.assertIn("times (N,) in seconds", lamina.Mapping.add.__doc__)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
