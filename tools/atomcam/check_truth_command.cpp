// atomcam check-truth: do a stack's frames show what its truth says?

#include <fmt/format.h>

#include <cmath>
#include <memory>

#include "atomcam/commands.hpp"
#include "atomcam/lab_argument.hpp"
#include "atomcam/run_command.hpp"
#include "atomcam/set_option.hpp"
#include "atomcam/truth_check.hpp"
#include "atomcam/truth_picture.hpp"
#include "base/error.hpp"
#include "data/png.hpp"

namespace atomcam {
namespace {

struct CheckOptions {
  std::string stack;
  std::string lab;
  std::string picture;
  std::vector<std::string> settings;
  double position_px = 0.1;
  double sigmas = 5;
};

Lab lab_of(const CheckOptions& options, const StackNotes& notes) {
  if (!options.lab.empty()) return lab_of_argument(options.lab, options.settings);
  if (notes.lab.empty()) throw Error("--lab", options.stack + " does not say which lab it shows");
  Lab lab = parse_lab(notes.lab, options.stack);
  apply_settings(lab, options.settings);
  return lab;
}

bool report(const char* what, bool pass, const std::string& line) {
  fmt::print("  {:<11} {}  {}\n", what, pass ? "pass" : "FAIL", line);
  return pass;
}

void run(const CheckOptions& options) {
  const auto stack = open_stack(options.stack);
  if (stack->frames() == 0) throw Error(options.stack, "no frames");
  const Lab lab = lab_of(options, stack->notes());
  const StackSettings settings = StackSettings::parse(stack->notes().settings, options.stack);
  if (!options.picture.empty())
    write_png(options.picture,
              truth_picture(stack->counts(0), frame_atoms(stack->truth(0), options.stack), lab, settings));
  const TruthCheck check = check_truth(*stack, lab, settings, options.stack);

  SiteCheck far, odd, lit;
  double far_px = 0, mean_x = 0, mean_y = 0;
  for (const SiteCheck& site : check.sites) {
    const double distance = std::hypot(site.dx_px, site.dy_px);
    if (distance >= far_px) far = site, far_px = distance;
    if (std::fabs(site.deviation_sigma) >= std::fabs(odd.deviation_sigma)) odd = site;
    if (std::fabs(site.empty_sigma) >= std::fabs(lit.empty_sigma)) lit = site;
    mean_x += site.dx_px / static_cast<double>(check.sites.size());
    mean_y += site.dy_px / static_cast<double>(check.sites.size());
  }
  fmt::print(
      "{}: {}, {} frames of {} x {} pixels, {} sites, {} images of atoms{}\n", options.stack, settings.camera,
      check.frames, stack->shape().columns, stack->shape().rows, lab.scene.sites.size(), check.atom_images,
      check.dim_sites ? fmt::format(" ({} sites have too little light to tell)", check.dim_sites) : "");
  bool pass = report("atoms", !check.sites.empty(), fmt::format("{} sites judged", check.sites.size()));
  pass &= report(
      "position", far_px < options.position_px,
      fmt::format(
          "worst mean {:.3f} px from the truth (site {}; limit {}), all together ({:+.4f}, {:+.4f}) px",
          far_px, far.site, options.position_px, mean_x, mean_y));
  pass &= report(
      "brightness", std::fabs(odd.deviation_sigma) < options.sigmas,
      fmt::format(
          "worst {:+.1f} sigma from the truth (site {}; limit {}), all together {:.4f} +- {:.4f} of it",
          odd.deviation_sigma, odd.site, options.sigmas, check.brightness, check.brightness_error));
  pass &= report("empty sites", std::fabs(lit.empty_sigma) < options.sigmas,
                 fmt::format("worst {:+.1f} sigma from darkness (site {}; limit {})", lit.empty_sigma,
                             lit.site, options.sigmas));
  if (!pass) throw Failure(options.stack + ": the frames do not show what the truth says");
}

}  // namespace

void add_check_truth_command(CLI::App& app) {
  auto options = std::make_shared<CheckOptions>();
  CLI::App* command = app.add_subcommand(
      "check-truth", "Check that the atoms of a stack stand where its truth says, as bright as it says");
  command->add_option("STACK", options->stack, "A file of `atomcam render` or `atomcam grab`")->required();
  command->add_option("--lab", options->lab,
                      "The lab that the camera shows (default: as the stack notes it)");
  add_set_option(*command, options->settings);
  command->add_option("--picture", options->picture,
                      "Also write the first frame beside its ground truth (.png)");
  command
      ->add_option("--position", options->position_px, "Allowed distance of an atom's mean position, pixels")
      ->capture_default_str();
  command->add_option("--sigmas", options->sigmas, "Allowed deviation of a brightness, standard errors")
      ->capture_default_str();
  command->footer(
      "Examples:\n"
      "  atomcam check-truth frames.tif --picture frames.png\n"
      "  atomcam check-truth grabbed.h5 --lab ixon-ultra-897");
  command->callback([options] { run_command("check-truth", [&] { run(*options); }); });
}

}  // namespace atomcam
