"""Judging detectors from Python: the numbers of the command, and laws that every judgement obeys."""

import json
import os
import subprocess
import tempfile
import unittest

import numpy as np

import atomcam
import practice


class Judgements(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        # So dim that detectors err, and lossy.
        cls.lab = practice.lab(**{"camera.exposure_s": 0.012, "atoms.survival": 0.8,
                                  "atoms.reference_exposure_s": 0.012})
        cls.counts, cls.truth = cls.lab.render(200)
        cls.random = np.random.default_rng(5)

    def detected(self, kind, **options):
        detector = atomcam.Detector(kind, self.lab, **options)
        detector.teach(self.counts[::2], self.truth[::2])
        return detector, atomcam.score(detector.scores(self.counts[1::2]), self.truth[1::2], self.lab,
                                       threshold=detector.threshold)

    def test_is_the_commands(self):
        probabilities = self.random.random((200, 16)).astype(np.float32)
        with tempfile.TemporaryDirectory() as folder:
            self.lab.save(os.path.join(folder, "lab.toml"))
            np.save(os.path.join(folder, "said.npy"), probabilities)

            def command(*arguments):
                return subprocess.run([os.environ["ATOMCAM"], *arguments], cwd=folder, check=True,
                                      capture_output=True, text=True).stdout

            command("render", "lab.toml", "-n", "200", "-o", "frames.npy")
            for end in ("start", "end"):
                printed = command("score", "frames.npy", "--result", "said.npy", "--json", "--threshold", "0.25",
                                  "--filled", end)
                mine = atomcam.score(probabilities, self.truth, self.lab, threshold=0.25, filled=end)
                self.assertEqual(mine.as_dict(), json.loads(printed))
            for kind in ("threshold", "matched"):
                printed = command("score", "frames.npy", "--detector", kind, "--json", "--roc", "roc.csv")
                _, mine = self.detected(kind)
                self.assertEqual(mine.as_dict(), json.loads(printed))
                np.testing.assert_array_equal(
                    mine.roc, np.loadtxt(os.path.join(folder, "roc.csv"), delimiter=",", skiprows=1))

    def test_the_truth_is_without_fault(self):
        judged = atomcam.score(self.truth.present_at_start, self.truth, self.lab)
        self.assertEqual((judged.fidelity.value, judged.found.value, judged.false_alarms.value), (1, 1, 0))
        self.assertEqual((judged.auc, judged.best_fidelity), (1, 1))
        self.assertGreater(judged.fidelity.error, 0)
        self.assertEqual((judged.fidelity.part, judged.frames, judged.sites), (3200, 200, 16))
        # The wrong way round, it is always wrong.
        self.assertEqual(atomcam.score(~self.truth.present_at_start, self.truth).fidelity.value, 0)

    def test_chance_is_chance(self):
        judged = atomcam.score(self.random.random((200, 16)), self.truth, self.lab, threshold=0.3)
        self.assertLess(abs(judged.auc - 0.5), 5 * judged.auc_error)
        for share in (judged.found, judged.false_alarms):
            self.assertLess(abs(share.value - 0.7), 5 * share.error)
        np.testing.assert_array_equal(judged.roc[[0, -1], 1:], [[0, 0], [1, 1]])
        self.assertTrue((np.diff(judged.roc[:, 1:], axis=0) >= 0).all())

    def test_parts(self):
        _, judged = self.detected("matched")
        filled = self.truth[1::2].present_at_start
        for rows in (judged.by_brightness, judged.by_loss, judged.by_neighbours):
            self.assertEqual(sum(row.found.number for row in rows if row.found), filled.sum())
        # An atom that is lost early shines less.
        first, last = judged.by_loss[0].found, judged.by_loss[4].found
        self.assertGreater(last.value - first.value, 5 * np.hypot(first.error, last.error))
        self.assertEqual((judged.by_loss[0].start, judged.by_loss[-1].stop), (0, np.inf))
        # Counted anew: neighbours are up, down, left and right in the grid.
        grid = np.pad(filled.reshape(-1, 4, 4), ((0, 0), (1, 1), (1, 1)))
        near = grid[:, :-2, 1:-1].astype(int) + grid[:, 2:, 1:-1] + grid[:, 1:-1, :-2] + grid[:, 1:-1, 2:]
        for count, row in enumerate(judged.by_neighbours):
            self.assertEqual(row.found.number, (filled.reshape(-1, 4, 4) & (near == count)).sum())

    def test_detectors(self):
        (threshold, by_sum), (matched, by_filter) = self.detected("threshold"), self.detected("matched")
        self.assertGreater(by_sum.auc, 0.5 + 5 * by_sum.auc_error)
        self.assertGreater(by_filter.auc, by_sum.auc)
        scores = threshold.scores(self.counts)
        self.assertEqual((scores.shape, scores.dtype), ((200, 16), np.float32))
        np.testing.assert_array_equal(threshold(self.counts), scores >= threshold.threshold)
        # A square around the site, summed.
        x, y = (int(round(one)) for one in practice.PLACES[5])
        wide = atomcam.Detector("threshold", self.lab, half_width_px=2)
        wide.teach(self.counts, self.truth.present_at_start)
        np.testing.assert_array_equal(
            wide.scores(self.counts)[:, 5], self.counts[:, y - 2 : y + 3, x - 2 : x + 3].sum((1, 2)))
        self.assertIn("matched", repr(matched))

    def test_shots_of_several_images(self):
        said = self.random.random((200, 16))
        flat = atomcam.score(said, self.truth, self.lab)
        self.assertEqual(atomcam.score(said.reshape(100, 2, 16), self.truth, self.lab).as_dict(), flat.as_dict())
        by_flags = atomcam.score(said.reshape(100, 2, 16), self.truth.present_at_start.reshape(100, 2, 16))
        self.assertEqual(by_flags.fidelity, flat.fidelity)
        self.assertEqual((by_flags.by_brightness, by_flags.by_loss, by_flags.by_neighbours), ((), (), ()))

    def test_a_score_at_the_threshold_is_called_filled(self):
        for threshold in (0.1, 0.3, 0.7, 0.9):
            truth = np.array([[True, False]] * 4)
            judged = atomcam.score(np.where(truth, threshold, threshold - 0.01), truth, threshold=threshold)
            self.assertEqual((judged.fidelity.value, judged.threshold), (1, threshold))

    def test_refuses(self):
        said, truth = self.random.random((200, 16)), self.truth
        missing = said.copy()
        missing[7, 3] = np.nan
        untaught = atomcam.Detector("matched", self.lab)
        for words, attempt in [
                ("scores: shape", lambda: atomcam.score(said[:100], truth)),
                ("scores: shape", lambda: atomcam.score(said[:, :8], truth)),
                ("scores", lambda: atomcam.score(said[0], truth)),
                ("scores", lambda: atomcam.score(said.astype(str), truth)),
                ("frame 7, site 3", lambda: atomcam.score(missing, truth)),
                ("truth", lambda: atomcam.score(said, said)),
                ("both kinds", lambda: atomcam.score(said, np.ones((200, 16), bool))),
                ("start, end", lambda: atomcam.score(said, truth, filled="middle")),
                ("lab: 306 sites", lambda: atomcam.score(said, truth, atomcam.Lab())),
                ("threshold, matched", lambda: atomcam.Detector("neural", self.lab)),
                ("half_width_px", lambda: atomcam.Detector("matched", self.lab, half_width_px=33)),
                ("not been taught", lambda: untaught.threshold),
                ("not been taught", lambda: untaught(self.counts)),
                ("64 x 64", lambda: untaught.teach(self.counts[:, :32], truth)),
                ("truth: shape", lambda: untaught.teach(self.counts[:10], truth)),
                ("both kinds", lambda: untaught.teach(self.counts, np.zeros((200, 16), bool)))]:
            with self.assertRaisesRegex(atomcam.Error, words):
                attempt()


if __name__ == "__main__":
    unittest.main()
