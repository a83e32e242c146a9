#include "effects/patterns.hpp"

namespace atomcam {
namespace {

class AtomHopping : public Effect {
 public:
  explicit AtomHopping(const ParameterValues& values) : probability_(values[0]) {}

  void apply_to_scene(SceneFrame& scene, const FrameContext& context) const override {
    const std::vector<Site>& sites = context.scene->sites;
    const std::size_t emitters = scene.emitters.size();
    for (std::size_t e = 0; e < emitters; ++e) {
      const int from = scene.emitters[e].site;
      if (from < 0) continue;
      RandomStream random = context.random("hop", static_cast<std::uint32_t>(from));
      if (random.uniform() >= probability_) continue;
      const double start_s = scene.emitters[e].start_s, end_s = scene.emitters[e].end_s;
      const double hop_s = start_s + random.uniform() * (end_s - start_s);
      const int to = neighbour(sites, from, random);
      scene.emitters[e].end_s = hop_s;
      scene.atoms[from].present_at_end = false;
      scene.atoms[from].loss_time_s = hop_s;
      if (to < 0) continue;
      bool filled = false;
      for (Emitter& other : scene.emitters)
        if (other.site == to && other.end_s > hop_s) {
          // Two atoms in one trap under imaging light: a light-assisted collision loses both.
          other.end_s = std::max(other.start_s, hop_s);
          filled = true;
        }
      if (filled) {
        scene.atoms[to].present_at_end = false;
        scene.atoms[to].loss_time_s = hop_s;
        continue;
      }
      Emitter arrived = scene.emitters[e];
      arrived.site = to;
      arrived.x_px += sites[to].x_px - sites[from].x_px;
      arrived.y_px += sites[to].y_px - sites[from].y_px;
      arrived.start_s = hop_s;
      arrived.end_s = end_s;
      scene.emitters.push_back(arrived);
      scene.atoms[to].present_at_end = true;
    }
  }

 private:
  double probability_;

  /// One of the sites next to `from` (within 1.2 times the distance of the nearest), or -1.
  static int neighbour(const std::vector<Site>& sites, int from, RandomStream& random) {
    const auto distance2 = [&](std::size_t s) {
      const double dx = sites[s].x_px - sites[from].x_px, dy = sites[s].y_px - sites[from].y_px;
      return dx * dx + dy * dy;
    };
    double nearest = never;
    for (std::size_t s = 0; s < sites.size(); ++s)
      if (static_cast<int>(s) != from) nearest = std::min(nearest, distance2(s));
    std::vector<int> near;
    for (std::size_t s = 0; s < sites.size(); ++s)
      if (static_cast<int>(s) != from && distance2(s) <= 1.44 * nearest) near.push_back(static_cast<int>(s));
    if (near.empty()) return -1;
    return near[static_cast<std::size_t>(random.uniform() * static_cast<double>(near.size()))];
  }
};

}  // namespace

EffectDeclaration atom_hopping() {
  return {
      .name = "atom_hopping",
      .plane = Plane::scene,
      .summary = "Atoms hop to a neighbouring trap during the exposure.",
      .reference =
          "Site hopping in optical lattices and tweezer arrays under imaging light: 0.1-2 % per frame",
      .parameters =
          {{.key = "probability",
            .unit = "1",
            .minimum = 0,
            .maximum = 0.5,
            .default_value = 0.01,
            .scale = ParameterScale::linear,
            .meaning =
                "Probability that an atom hops once during a frame; on a filled site both atoms are lost."}},
      .observables = {"neighbour_exchange", "site_histogram"},
      .emccd = true,
      .qcmos = true,
      .make = make_effect<AtomHopping>};
}

}  // namespace atomcam
