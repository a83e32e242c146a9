"""Rendering on a Dask cluster gives the bits of one process."""

import os
import sys
import unittest

import numpy as np

import atomcam
import small

try:
    import dask
    import distributed

    import atomcam.dask
except ImportError as missing:
    print(f"skipped: {missing}")
    sys.exit(77)


def who(counts):
    """The process that holds a block."""
    return np.full((len(counts), 1, 1), os.getpid())


class Cluster(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        dask.config.set({"distributed.worker.daemon": True, "distributed.admin.tick.limit": "30s"})
        cls.cluster = cls.enterClassContext(
            distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None,
                                     host="127.0.0.1", local_directory=None))
        cls.client = cls.enterClassContext(distributed.Client(cls.cluster))

    def test_two_workers_give_the_bits_of_one_process(self):
        for preset in atomcam.presets():
            lab = small.lab(preset, **{"effects.pointing_drift": 0.3, "seed": 9})
            expected, true = lab.render(46, 1000)
            counts, truth = atomcam.dask.render(lab, 46, 1000, block=5)
            self.assertEqual((counts.shape, counts.dtype), (expected.shape, expected.dtype))
            self.assertEqual(counts.chunks[0], (5,) * 9 + (1,))
            lab["seed"] = 10  # too late
            got, arrays = dask.compute(counts, truth.arrays())
            np.testing.assert_array_equal(got, expected)
            for name, array in true.arrays().items():
                np.testing.assert_array_equal(arrays[name], array, err_msg=name)
                self.assertEqual(arrays[name].dtype, array.dtype)

    def test_both_workers_render(self):
        counts, _ = atomcam.dask.render(small.lab(), 400, block=10)
        processes = counts.map_blocks(who, dtype=int, chunks=(counts.chunks[0], (1,), (1,))).compute()
        self.assertEqual(len(np.unique(processes)), 2)
        self.assertNotIn(os.getpid(), processes)


class Lazy(unittest.TestCase):
    def test_only_what_is_asked_for_is_rendered(self):
        lab = small.lab()
        counts, truth = atomcam.dask.render(lab, 10**5, block=2000, seed=4)
        with dask.config.set(scheduler="synchronous"):
            np.testing.assert_array_equal(counts[60007:60009].compute(), lab.render(2, 60007, seed=4)[0])
        self.assertEqual(truth.frame.shape, (10**5,))

    def test_names_follow_from_what_is_rendered(self):
        lab = small.lab()
        name = atomcam.dask.render(lab, 20)[0].name
        self.assertEqual(atomcam.dask.render(lab.copy(), 20)[0].name, name)
        self.assertNotEqual(atomcam.dask.render(lab, 20, seed=3)[0].name, name)
        lab["camera.em_gain"] = 10
        self.assertNotEqual(atomcam.dask.render(lab, 20)[0].name, name)

    def test_wrong_arguments(self):
        for options in ({"frames": -1}, {"frames": 3, "block": 0}, {"frames": 3, "threads": 0}, {"frames": 2.5}):
            with self.assertRaises(atomcam.Error):
                atomcam.dask.render(small.lab(), **options)
        lab = small.lab(**{"camera.width_px": 1000})
        with self.assertRaisesRegex(atomcam.Error, "region"):
            atomcam.dask.render(lab, 3)


if __name__ == "__main__":
    unittest.main()
