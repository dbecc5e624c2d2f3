"""The Python module: module_test.py PROGRAM STUBS."""
import ast
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

import lamina

PROGRAM, STUBS = sys.argv[1:3]
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
            recording = lamina.Recording(str(scans))
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
            truth = lamina.read_trajectory(str(scans / "poses.txt")).poses
            errors = lamina.evaluate(program, truth)
            self.assertLess(errors["ape_rmse_m"], 0.02)
            self.assertEqual(errors["poses"], 12)
            with self.assertRaises(lamina.InputError):
                lamina.evaluate(program[:5], truth)
            with self.assertRaisesRegex(lamina.InputError, "is no pose"):
                lamina.evaluate(2.0 * program, truth)
        with self.assertRaisesRegex(lamina.InputError, "not/there"):
            lamina.Recording("not/there")

    def test_everything_is_typed(self):
        tree = ast.parse(Path(STUBS).read_text())
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


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
