#pragma once
// Which of the judged models, if any, is named as the explanation.

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "diagnosis/diagnosis.hpp"
#include "diagnosis/model.hpp"

namespace atomcam {

/// Of the gap, for an effect to be named that the frames are not odd under: on all frames, and on held-out
/// ones at the best of its interval.
inline constexpr double least_closed = 0.85;
/// Of the gap on held-out frames, for an effect to be named under which the frames are odd.
inline constexpr double least_closed_if_odd = 0.9;
/// On all frames as well, where these are too odd for an explanation: the effect is then named in part.
inline constexpr double least_closed_if_rejected = 0.96;
/// Of the gap in its own observables, for an effect to be named that explains no others.
inline constexpr double least_part_closed = 0.75;

/// The observable in which a model has its largest gap.
std::string most_missed(const Model& model, const std::vector<StatisticDeclaration>& battery);

/// The frames are odd under a model, even if it passes: at the place where it was judged, or at another one
/// as likely.
bool odd_under(const Model& model);

/// The model that the real stack's statistics are likeliest under. One model or more.
Model& likeliest(std::span<Model> models);

/// A model that is named.
struct Named {
  Model* model = nullptr;
  Verdict verdict = Verdict::explained;
  double probability = 1;
  std::vector<std::string> confusable_with;  // effects of other models that the data cannot tell from it
};

/// By how much less of a gap a model may close if the gap is hardly larger than what stacks differ by that
/// have none: what is left of it is mostly chance. 0 for a large gap, and where the frames are too odd at
/// another place that is as likely.
double chance_of(const Model& model, const Model& plain);

/// Whether what a model closes on held-out frames speaks against naming it. At the best of what they may
/// mean; as they are, where all frames are a little odd as well.
bool closes_too_little(const GapClosed& held_out, const Model& found, const Model& plain);

/// Its effects with their parameters at the estimates.
std::vector<FoundEffect> found_effects(const Named& named);

inline constexpr double clear_difference = 5.5;  // deviations from a model that nobody's camera explains

/// From where on a deviation is clear, whatever the p-value: `least` standard deviations, and more than what
/// every other of a model's own stacks (a row each) has somewhere.
double clear_difference_of(const Eigen::MatrixXd& own, double least = clear_difference);

class Naming {
 public:
  /// What is judged before must outlive this.
  Naming(const Model& plain, const BatteryValues& real, const std::vector<StatisticDeclaration>& battery)
      : plain_(plain), real_(real), battery_(battery) {}

  /// The frames are as the model's own stacks, and it takes the gap away.
  bool passes(const Model& model) const { return objection(model).empty(); }
  /// Why it does not pass, in words; empty if it does.
  std::string objection(const Model& model) const;
  /// The statistic that speaks against it: the oddest under a model that is rejected, or one that it leaves
  /// as it was or does not touch; none: -1.
  Eigen::Index left_by(const Model& model) const;
  /// A clear difference is left as it was, or made: whatever the effect takes away, it is not what made that.
  bool contradicted(const Model& model) const { return largest_as_it_was(model) >= 0; }
  /// What of the model's effects its stacks show where it is to show, and the frames do not, in words; none:
  /// empty.
  std::string not_seen(const Model& model) const;
  /// What its effects are known by and the frames do not show, in words; none: empty. It is not named then:
  /// at most another model that passes is not told apart from it.
  std::string not_known(const Model& model) const;
  /// Of the models that pass the one that is by far the likeliest, or the first of several that the data
  /// cannot tell apart.
  std::optional<Named> choose(std::span<Model> models) const;
  /// No model passes: one that closes nearly all of a large gap is named all the same, with what it leaves.
  /// It counts as the explanation if that is as little as one in a thousand of its own stacks has:
  /// everybody's camera differs a little from the plain model, and nothing of the catalogue makes that
  /// difference.
  std::optional<Named> nearest(std::span<Model> models) const;

 private:
  /// The frames are likelier with its effects than without; what explains only a part of the gap has its own
  /// measure.
  bool likelier(const Model& model) const;
  /// Nothing speaks against its effects, however much they close.
  bool may_be(const Model& model) const;
  bool competes(const Model& model) const;
  std::vector<double> odds_among(const std::vector<Model*>& models) const;
  Named choose_among(std::vector<Model*> passed, const std::vector<Model*>& beside) const;
  bool takes_nearly_all(const Model& model) const;
  /// The observable in which the plain model misses most, if the frames are odd under the model in it, too.
  std::string odd_where_most_was(const Model& model) const;
  double closed_by(const Model& model) const;
  /// The parameter of which the frames want more than the model's effect can be; none: empty.
  std::string wanted_more_of(const Model& model) const;
  /// What parts of the plain model's stacks and of a model's show no more in these observables than the
  /// frames do: no smaller deviations from the plain model.
  struct Below {
    double without = 0, with_it = 0;
  };
  Below below(const Model& model, const std::vector<std::string>& observables) const;
  double further_along(const Model& model, const std::vector<std::string>& observables) const;
  std::string what_is_left(const Model& model, Eigen::Index at) const;
  /// Where the largest difference is that is clear and as it was; none: -1.
  Eigen::Index largest_as_it_was(const Model& model) const;
  /// The oddest statistic that hardly any of the model's stacks has half as odd; none: -1.
  Eigen::Index foreign_to(const Model& model) const;

  const Model& plain_;
  const BatteryValues& real_;
  const std::vector<StatisticDeclaration>& battery_;
};

}  // namespace atomcam
