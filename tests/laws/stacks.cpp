#include "laws/stacks.hpp"

#include <atomic>
#include <memory>
#include <thread>

namespace atomcam::laws {

Lab law_lab(CameraKind kind) {
  Lab lab = preset(kind == CameraKind::emccd ? "ixon-ultra-897" : "orca-quest");
  lab.effects.clear();
  std::visit([](auto& sensor) { sensor.shape = {side_px, side_px}; }, lab.sensor);
  lab.settings.region = {0, 0, side_px, side_px};
  lab.settings.binning_x = lab.settings.binning_y = 1;
  lab.settings.em_gain = 100;
  lab.settings.exposure_s = 0.04;
  lab.settings.frame_interval_s = 1;
  // Every pixel sees 0.2048 um of the atoms' plane, on either camera.
  lab.optics.magnification = lab.optics.pixel_um / 0.2048;
  std::vector<Site> sites;
  for (int site = 0; site < site_count; ++site)
    sites.push_back({site_place(site).x_px, site_place(site).y_px, 1});
  lab.layout = sites;
  lab.scene.survival = 1;
  lab.scene.images_per_shot = 2;
  lab.scene.scattering_rate_hz = 400000;
  lab.given_occupancies.assign(2, Occupancy(site_count));
  for (int pair = 0; pair < 2; ++pair)
    for (int site = 0; site < site_count; ++site)
      lab.given_occupancies[static_cast<std::size_t>(pair)][static_cast<std::size_t>(site)] =
          filled(site, pair);
  lab.stray_light_photons_per_s = 25 / 0.86 / lab.settings.exposure_s;
  lab.place_sites();
  return lab;
}

std::vector<Case> cases() {
  std::vector<Case> all;
  for (const EffectDeclaration& effect : effect_catalogue()) {
    if (effect.emccd) all.push_back({&effect, CameraKind::emccd});
    if (effect.qcmos) all.push_back({&effect, CameraKind::qcmos});
  }
  return all;
}

Stacks render_stacks(const Lab& lab, const Simulation* like) {
  Lab without = lab;
  without.given_occupancies.clear();
  without.scene.filling = 0;
  CameraSettings closed = lab.settings;
  closed.shutter_open = false;
  const auto simulation_of = [like](const Lab& one) {
    return like ? std::make_unique<Simulation>(one, *like) : std::make_unique<Simulation>(one);
  };
  const auto with_atoms = simulation_of(lab), without_atoms = simulation_of(without);
  Stacks stacks;
  Stack* const into[] = {&stacks.atoms, &stacks.empty, &stacks.dark};
  for (Stack* stack : into) stack->frames.resize(2 * pairs);
  std::atomic<int> next = 0;
  const auto work = [&] {
    for (int task = next++; task < 3 * 2 * pairs; task = next++) {
      const int kind = task / (2 * pairs), frame = task % (2 * pairs);
      // An odd number of shots apart, so that the two occupancies take turns; each stack at a time of its
      // own.
      const std::uint64_t shot = 1001 * static_cast<std::uint64_t>(frame / 2) + 200000 * kind;
      const Simulation& simulation = kind == 0 ? *with_atoms : *without_atoms;
      into[kind]->frames[static_cast<std::size_t>(frame)] =
          simulation
              .render(2 * shot + static_cast<std::uint64_t>(frame % 2), kind == 2 ? closed : lab.settings)
              .counts;
    }
  };
  std::vector<std::thread> threads;
  for (unsigned i = 1; i < std::max(1u, std::thread::hardware_concurrency()); ++i) threads.emplace_back(work);
  work();
  for (std::thread& thread : threads) thread.join();
  const ReadoutMode& mode =
      with_atoms->sensor().readout_modes()[static_cast<std::size_t>(lab.settings.readout_mode)];
  stacks.bias_counts = lab.settings.bias_counts;
  stacks.counts_per_electron =
      (lab.kind() == CameraKind::emccd ? lab.settings.em_gain : 1) / mode.electrons_per_count;
  stacks.read_noise_counts = mode.read_noise_e / mode.electrons_per_count;
  return stacks;
}

}  // namespace atomcam::laws
