#pragma once
// Distances between two distributions that are known by samples.

#include <cstdint>
#include <span>
#include <vector>

namespace atomcam {

/// First Wasserstein distance between two histograms over the same bins, in bin widths: how far the one's
/// mass has to be moved, on average, to become the other. NaN if one is empty.
double wasserstein(std::span<const std::uint64_t> one, std::span<const std::uint64_t> two);

/// The same between two samples, in their unit; both are sorted on the way.
double wasserstein_of_samples(std::vector<float> one, std::vector<float> two);

/// Bins of counts, each with at least 50 of the pool's pixels and at most about a 256th of them, finer
/// towards the tails: [first count of each bin], the last bin open.
std::vector<std::size_t> count_bins(std::span<const std::uint64_t> pool);
std::vector<std::uint64_t> binned(std::span<const std::uint64_t> occurrences,
                                  const std::vector<std::size_t>& bins);

/// Half the sum of the Kullback-Leibler divergences of each histogram from the other, nats; half a pixel is
/// added to each bin. NaN if one is empty.
double divergence(std::span<const std::uint64_t> one, std::span<const std::uint64_t> two);

}  // namespace atomcam
