#pragma once
// A classifier two-sample test: how well a logistic regression tells frames of one kind from another that it
// has not learned from.

#include <Eigen/Dense>
#include <span>
#include <vector>

namespace atomcam {

/// Area under the curve: how often one drawn of `high` scores above one drawn of `low`, ties half.
double area_under_curve(std::vector<double> high, std::vector<double> low);

/// Of frames [frame, feature], with the fold that tests each.
struct LabelledFrames {
  Eigen::MatrixXd features;
  std::vector<int> fold;
};

struct TwoSampleTest {
  double auc = 0.5;  // mean over the folds; about 0.5 where nothing tells the two apart
  double error = 0;  // standard error, from the scatter between the folds
};

/// Each fold is told apart by a regression (ridge, both kinds weighing the same) that learned from the
/// others. Features are scaled by the others' standard deviations in `low`. NaN with fewer than two folds.
TwoSampleTest two_sample_test(const LabelledFrames& high, const std::vector<const LabelledFrames*>& low);

}  // namespace atomcam
