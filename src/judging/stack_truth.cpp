#include "judging/stack_truth.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/error.hpp"

namespace atomcam {

std::vector<std::vector<std::size_t>> neighbours_of(std::span<const Site> sites) {
  const auto distance = [&](std::size_t i, std::size_t j) {
    return std::hypot(sites[i].x_px - sites[j].x_px, sites[i].y_px - sites[j].y_px);
  };
  double smallest = INFINITY;
  for (std::size_t i = 0; i < sites.size(); ++i)
    for (std::size_t j = 0; j < i; ++j) smallest = std::min(smallest, distance(i, j));
  std::vector<std::vector<std::size_t>> neighbours(sites.size());
  for (std::size_t i = 0; i < sites.size(); ++i)
    for (std::size_t j = 0; j < sites.size(); ++j)
      if (i != j && distance(i, j) < 1.2 * smallest) neighbours[i].push_back(j);
  return neighbours;
}

std::vector<SiteTruth> stack_truth(StackReader& stack, std::span<const Site> sites, FilledAt when) {
  const auto neighbours = neighbours_of(sites);
  std::vector<SiteTruth> truth(stack.frames() * sites.size());
  for (std::uint64_t n = 0; n < stack.frames(); ++n) {
    const auto fail = [&](const std::string& problem) -> Error {
      return Error(stack.file().string(), fmt::format("frame {}: {}", n, problem));
    };
    const std::span<SiteTruth> frame = std::span(truth).subspan(n * sites.size(), sites.size());
    try {
      const auto json = nlohmann::json::parse(stack.truth(n));
      const std::string initial = json.at("initial"), last = json.at("final");
      if (initial.size() != sites.size() || last.size() != sites.size())
        throw fail(fmt::format("truth about {} sites; the lab has {}", initial.size(), sites.size()));
      for (std::size_t i = 0; i < sites.size(); ++i) {
        frame[i].filled = (when == FilledAt::start ? initial : last)[i] == '1';
        frame[i].lost = initial[i] == '1' && last[i] == '0';
        for (const std::size_t j : neighbours[i]) frame[i].neighbours += initial[j] == '1';
      }
      for (const auto& atom : json.at("atoms")) {
        SiteTruth& site = frame[std::min(atom.at("site").get<std::size_t>(), sites.size() - 1)];
        site.electrons = atom.at("detected_e");
        if (const auto loss = atom.find("loss_s"); loss != atom.end()) site.loss_s = *loss;
      }
    } catch (const nlohmann::json::exception&) {
      throw fail("no truth; frames of `atomcam render` and of a camera of `atomcam serve` have it");
    }
  }
  return truth;
}

}  // namespace atomcam
