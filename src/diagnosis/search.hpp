#pragma once
// Which effect, or which two or three, explain a gap: a scan of the catalogue, closer looks at what it speaks
// for, fits by simulation from several starts, and the verdict on what they come to.

#include <array>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "analysis/stripes.hpp"
#include "diagnosis/contenders.hpp"
#include "diagnosis/diagnosis.hpp"
#include "diagnosis/naming.hpp"
#include "diagnosis/scan.hpp"

namespace atomcam {

/// What is searched, known before; it must outlive the search.
struct SearchGround {
  const Model& plain;  // judged
  RealStack real;
  const FrameSequence& frames;
  const FrameSequence* darks;  // null: none
  const StackPlan& plan;
  const std::vector<StatisticDeclaration>& battery;
  std::vector<std::string> excluded;  // effects
  DiagnosisProgress progress;
};

/// What explains the frames, or a part of what is odd in them.
struct Found {
  Verdict verdict = Verdict::explained;
  std::vector<FoundEffect> effects;
  Model model;
};

class Search {
 public:
  explicit Search(SearchGround ground)
      : ground_(std::move(ground)), naming_(ground_.plain, *ground_.real.values, ground_.battery) {}

  /// Empty if nothing in the catalogue explains the gap.
  std::optional<Found> run();

  /// Of every effect, the most promising first; the search has none any more.
  std::vector<Scan> take_scans() { return std::move(scans_); }
  /// All that was tried.
  std::vector<Hypothesis> hypotheses;

 private:
  std::optional<Found> whole();
  std::optional<Found> with_what_it_hides(const Named& named);
  std::vector<Contender> with_another(const Model& model, std::size_t most, double least_gain);
  struct Pairs {
    std::vector<Model> both_needed, undecided;
    std::vector<Contender> needed_alone;  // one of two, about where the pair has it
  };
  std::vector<PairMatch> matched_pairs() const;
  bool two_add_up() const;
  std::optional<Found> clear_pair();
  double how_near(Model model, double progress);
  std::vector<Contender> contenders(const std::vector<PairMatch>& matches);
  std::vector<Contender> contenders_beside(const Model& alone);
  Pairs pairs(std::span<Model> singles);
  std::vector<Model> triples(const Model& pair);
  std::optional<Found> in_part();

  FitGround fit_ground() const { return {&ground_.plain, ground_.real}; }
  bool atoms() const { return !ground_.plain.lab.scene.sites.empty(); }
  void scan();
  void look_closer();
  void note_scans();
  /// Where a fit may begin, from the surest to what is tried where nothing else leads on.
  enum class StartKind { best, seen, usual };
  std::vector<Contender> starts_of(const Scan& scan, StartKind from, StartKind to);
  std::vector<Contender> starts();
  std::vector<Contender> other_starts(std::span<Model> singles);
  struct Promising {
    const Scan* scan;
    PartMatch match;
  };
  using Asked = std::function<bool(const Scan&)>;
  std::vector<Promising> promising(const std::function<PartMatch(const Scan&)>& match, double least,
                                   std::size_t most, const Asked& asked) const;
  std::vector<Promising> promising_in(const std::string& observable, double least, std::size_t most,
                                      const Asked& asked) const;
  std::vector<Contender> overlooked(std::span<const Model> judged);
  void add_pair(const PairMatch& match, std::vector<Contender>& candidates);
  std::optional<Eigen::VectorXd> end_alone(const Scan& scan) const;
  const Scan& scan_of(const std::string& name) const;
  std::vector<Model> fit_and_judge(std::vector<Contender> contenders, double from, double to,
                                   const Before& before = {});
  /// What an effect is to explain by itself, and about which parameters.
  struct Part {
    const Scan& scan;
    PartMatch match;
    std::vector<std::string> observables;
  };
  const Scan* most_promising_part(const Model& before, const std::set<const Scan*>& tried) const;
  const Scan* hidden_beside(const Scan& scan, const Model& known) const;
  PartMatch match_in(const std::vector<std::string>& observables, const Scan& scan,
                     const ScanViews& real) const;
  bool shows(const Scan& law) const;
  std::optional<PartMatch> match_part_of_gap(const Model& before, const Scan& scan, const Scan* law,
                                             const std::vector<std::string>& observables) const;
  std::optional<Model> with_part(const Model& before, const Scan& scan, const Scan* law);
  std::vector<Model> fit_in_part(const Model& before, const Part& part, const Scan* law);
  void add_starts_of_shaking(std::vector<Contender>& contenders);
  const std::array<double, zernike_terms>& moving_zernikes();
  const std::optional<Stripes>& stripes();
  double closed_by_rival(const Model& before, const Part& part, const Scan* law, const Model& model);
  Model with(const Model& before, const Scan& scan, const Eigen::VectorXd& about);
  Model only(const Model& model, const std::vector<std::string>& names) const;
  bool likelier(const Model& model, const Model& fewer) const;
  bool settles(const Model& model, const Model& fewer) const;
  void note(const Model& model, double evidence);

  SearchGround ground_;
  Naming naming_;
  ScanViews seen_;  // the real stack
  std::vector<Scan> scans_;
  Ends ends_;
  std::map<std::string, StartKind> started_;  // the effects that were fitted alone, to which kind of start
  double part_progress_ = 0.86;
  std::optional<FieldFocus> field_focus_;
  std::optional<std::optional<Stripes>> stripes_;
  std::optional<std::array<double, zernike_terms>> moving_zernikes_;
};

}  // namespace atomcam
