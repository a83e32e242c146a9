#include "simulation/landing.hpp"

#include <algorithm>
#include <cmath>
#include <future>
#include <list>

#include "base/math.hpp"
#include "base/samplers.hpp"
#include "sensor/row_loops.hpp"
#include "simulation/parallel.hpp"

namespace atomcam {
namespace {

constexpr double defocus_step_um = 0.002;
constexpr double edge_loss_step = 0.004;
constexpr std::size_t batch = 4096;       // photons whose random words are drawn at once
constexpr double most_smeared = 1000000;  // electrons of an emitter's streak: far beyond any camera's

float largest(const RatioMap* map) {
  if (!map) return 1;
  const auto pixels = map->pixels();
  return pixels.empty() ? 1 : std::max(0.0f, *std::max_element(pixels.begin(), pixels.end()));
}

/// A Gaussian blur with its principal axes, in sensor pixels.
struct BlurAxes {
  double major_px, minor_px, cosine, sine;
  BlurAxes(const Emitter& emitter, double pixels_per_um)
      : major_px(emitter.blur_major_um * pixels_per_um),
        minor_px(emitter.blur_minor_um * pixels_per_um),
        cosine(math::cos_turns(emitter.blur_angle_deg / 360)),
        sine(math::sin_turns(emitter.blur_angle_deg / 360)) {}
  bool none() const { return major_px == 0 && minor_px == 0; }
};

constexpr std::uint32_t outside = 0xffffffff;  // key of a photon that is not seen

/// One stream's words for the photons of an emitter, batch after batch; in one go if one batch is all.
class PhotonWords {
 public:
  PhotonWords(PhiloxKey key, std::uint64_t frame, std::uint32_t emitter, std::int64_t photons)
      : key_(key),
        frame_(frame),
        emitter_(emitter),
        one_batch_(photons <= static_cast<std::int64_t>(batch)),
        stream_(key, frame, emitter) {}

  void fill(std::span<std::uint32_t> words) {
    if (one_batch_)
      fill_random(key_, frame_, emitter_, words);
    else
      for (std::uint32_t& word : words) word = stream_();
  }

 private:
  PhiloxKey key_;
  std::uint64_t frame_;
  std::uint32_t emitter_;
  bool one_batch_;
  RandomStream stream_;
};

/// Draws where the electrons of one emitter land, as keys row << 16 | column of the filled plane. Photons go
/// through the passes below in batches; a pass that the frame does not need is left out.
class EmitterLanding {
 public:
  EmitterLanding(const Landing& landing, float largest_response)
      : landing_(landing),
        light_(*landing.light),
        largest_response_(largest_response),
        exposed_(landing.seed, "optics/"),
        shifted_(landing.seed, "optics/smear/") {}

  void draw(int index, std::vector<std::uint32_t>& landed) const {
    draw(index, mean_of(index), exposed_, landed);
  }

  /// Those of the streak: they come while the frame is shifted, and are in another row by its end.
  void smear(int index, std::vector<std::uint32_t>& landed) const {
    if (!light_.smears()) return;
    const double most = std::max(light_.smear_from_above, light_.smear_from_below);
    const auto rows = static_cast<std::uint32_t>(landing_.plane().rows);
    const std::size_t first = landed.size();
    draw(index, std::min(most_smeared, most * rows * mean_of(index)), shifted_, landed);
    RandomStream row_stream(shifted_.row, landing_.frame, static_cast<std::uint32_t>(index));
    std::size_t kept = first;
    for (std::size_t i = first; i < landed.size(); ++i) {
      const std::uint32_t from = landed[i] >> 16, to = row_stream() % rows;
      const double share = to > from ? light_.smear_from_above : to < from ? light_.smear_from_below : most;
      if (row_stream.uniform() * most < share) landed[kept++] = to << 16 | (landed[i] & 0xffff);
    }
    landed.resize(kept);
  }

 private:
  struct Keys {
    PhiloxKey electrons, landing, blur, halo, scattered, time, response, row;
    Keys(std::uint64_t seed, const std::string& where)
        : electrons(stream_key(seed, stream_id(where + "electrons"))),
          landing(stream_key(seed, stream_id(where + "landing"))),
          blur(stream_key(seed, stream_id(where + "blur"))),
          halo(stream_key(seed, stream_id(where + "halo"))),
          scattered(stream_key(seed, stream_id(where + "scattered"))),
          time(stream_key(seed, stream_id(where + "time"))),
          response(stream_key(seed, stream_id(where + "response"))),
          row(stream_key(seed, stream_id(where + "row"))) {}
  };

  /// Electrons that the emitter gives the most sensitive pixels.
  double mean_of(int index) const {
    return (*light_.emitters)[index].emitted() * landing_.electrons_per_photon * largest_response_;
  }

  /// Appends where so many of the emitter's electrons land.
  void draw(int index, double mean, const Keys& keys, std::vector<std::uint32_t>& landed) const {
    const Emitter& emitter = (*light_.emitters)[index];
    const auto block = static_cast<std::uint32_t>(index);
    if (!(mean > 0)) return;
    RandomStream count_stream(keys.electrons, landing_.frame, block);
    const std::int64_t count = sample_poisson(count_stream, mean);
    const PointSpreadFunction& point_spread =
        landing_.point_spread->at(emitter.defocus_um, light_.pupil_edge_loss);
    const double centre_x = emitter.x_px + light_.shift_x_px, centre_y = emitter.y_px + light_.shift_y_px;
    const BlurAxes blur(emitter, landing_.pixels_per_um);
    const auto words_of = [&](PhiloxKey key) { return PhotonWords(key, landing_.frame, block, count); };
    PhotonWords landing = words_of(keys.landing), blurred = words_of(keys.blur), halo = words_of(keys.halo),
                time = words_of(keys.time), response = words_of(keys.response);
    RandomStream scattered(keys.scattered, landing_.frame, block);

    thread_local Photons photons;
    for (std::int64_t first = 0; first < count; first += static_cast<std::int64_t>(batch)) {
      photons.resize(std::min<std::size_t>(batch, static_cast<std::size_t>(count - first)));
      landing.fill(photons.words);
      point_spread.draw(photons.words, photons.displacements);
      for (std::size_t i = 0; i < photons.size(); ++i) {
        photons.x[i] = centre_x + static_cast<double>(photons.displacements[i].dx_px);
        photons.y[i] = centre_y + static_cast<double>(photons.displacements[i].dy_px);
      }
      if (!blur.none()) {
        blurred.fill(photons.words);
        spread(photons, blur);
      }
      const std::span<std::uint32_t> one_each(photons.words.data(), photons.size());
      if (light_.halo_fraction > 0) {
        halo.fill(one_each);
        scatter(photons, scattered);
      }
      find_pixels(photons);
      if (!landing_.window.global()) {
        time.fill(one_each);
        close_rows(photons, emitter);
      }
      if (light_.response_ratio) {
        response.fill(one_each);
        thin(photons);
      }
      std::size_t kept = landed.size();
      landed.resize(kept + photons.size());
      for (const std::uint32_t key : photons.keys) {
        landed[kept] = key;
        kept += key != outside;
      }
      landed.resize(kept);
    }
  }

  struct Photons {
    std::vector<std::uint32_t> words;  // two each, one where one is enough
    std::vector<PointSpreadFunction::Displacement> displacements;
    std::vector<float> normal;  // two each
    std::vector<double> x, y;   // sensor pixels
    std::vector<std::uint32_t> keys;
    std::size_t size() const { return keys.size(); }
    void resize(std::size_t count) {
      words.resize(2 * count);
      normal.resize(2 * count);
      displacements.resize(count);
      x.resize(count);
      y.resize(count);
      keys.resize(count);
    }
  };

  static void spread(Photons& photons, const BlurAxes& blur) {
    row_loops::normal_row(photons.words, photons.normal);
    for (std::size_t i = 0; i < photons.size(); ++i) {
      const double u = blur.major_px * static_cast<double>(photons.normal[2 * i]),
                   v = blur.minor_px * static_cast<double>(photons.normal[2 * i + 1]);
      photons.x[i] += blur.cosine * u - blur.sine * v;
      photons.y[i] += blur.sine * u + blur.cosine * v;
    }
  }

  void scatter(Photons& photons, RandomStream& random) const {
    for (std::size_t i = 0; i < photons.size(); ++i) {
      if (uniform(photons.words[i]) >= light_.halo_fraction) continue;
      const double angle = random.uniform(), radius = light_.halo_scale_px * sample_exponential(random);
      photons.x[i] += radius * math::cos_turns(angle);
      photons.y[i] += radius * math::sin_turns(angle);
    }
  }

  void find_pixels(Photons& photons) const {
    const Region& region = landing_.region;
    // Pixel p covers [p - 1/2, p + 1/2); half a pixel and a large whole number make truncation a floor.
    constexpr int lift = 1 << 20;
    const double to_row = lift + 0.5 - region.offset_y, to_column = lift + 0.5 - region.offset_x;
    const auto rows = static_cast<unsigned>(region.height), columns = static_cast<unsigned>(region.width);
    const auto binning_x = static_cast<unsigned>(landing_.binning_x),
               binning_y = static_cast<unsigned>(landing_.binning_y);
    for (std::size_t i = 0; i < photons.size(); ++i) {
      const auto row = static_cast<unsigned>(static_cast<int>(photons.y[i] + to_row) - lift);
      const auto column = static_cast<unsigned>(static_cast<int>(photons.x[i] + to_column) - lift);
      photons.keys[i] = row < rows && column < columns ? row << 16 | column : outside;
    }
    if (binning_x == 1 && binning_y == 1) return;
    for (std::uint32_t& key : photons.keys)
      if (key != outside) key = (key >> 16) / binning_y << 16 | (key & 0xffff) / binning_x;
  }

  /// A rolling shutter: a photon counts if its row is open when it arrives. (A sensor with one is not binned
  /// here.)
  void close_rows(Photons& photons, const Emitter& emitter) const {
    const double begin_s = landing_.window.light_begin_s + emitter.start_s;
    for (std::size_t i = 0; i < photons.size(); ++i) {
      std::uint32_t& key = photons.keys[i];
      const double time_s = begin_s + uniform(photons.words[i]) * (emitter.end_s - emitter.start_s);
      const double opens_s = landing_.window.row_begin_s(static_cast<int>(key >> 16));
      if (time_s < opens_s || time_s >= opens_s + landing_.window.exposure_s) key = outside;
    }
  }

  /// More photons were drawn than the most sensitive pixel sees; the others see fewer.
  void thin(Photons& photons) const {
    for (std::size_t i = 0; i < photons.size(); ++i) {
      std::uint32_t& key = photons.keys[i];
      const double level = uniform(photons.words[i]) * static_cast<double>(largest_response_);
      if (key != outside && level >= static_cast<double>((*light_.response_ratio)(
                                         static_cast<int>(key >> 16), static_cast<int>(key & 0xffff))))
        key = outside;
    }
  }

  const Landing& landing_;
  const LightField& light_;
  float largest_response_;
  Keys exposed_, shifted_;
};

/// Counting sort by row: what a readout takes.
PhotoElectrons by_row(std::span<const std::vector<std::uint32_t>> landed, int rows) {
  PhotoElectrons electrons;
  electrons.row_begin.assign(static_cast<std::size_t>(rows) + 1, 0);
  for (const auto& keys : landed)
    for (const std::uint32_t key : keys) ++electrons.row_begin[(key >> 16) + 1];
  for (std::size_t r = 1; r < electrons.row_begin.size(); ++r)
    electrons.row_begin[r] += electrons.row_begin[r - 1];
  electrons.columns.resize(electrons.row_begin.back());
  std::vector<std::uint32_t> next(electrons.row_begin.begin(), electrons.row_begin.end() - 1);
  for (const auto& keys : landed)
    for (const std::uint32_t key : keys)
      electrons.columns[next[key >> 16]++] = static_cast<std::uint16_t>(key);
  return electrons;
}

}  // namespace

namespace {

struct FunctionKey {
  OpticsDescription optics;
  int step;
  double blur_um;
  bool operator==(const FunctionKey&) const = default;
};
using SharedFunction = std::shared_ptr<const PointSpreadFunction>;

/// The last tables made (some MB each). Two threads make two tables side by side; one that wants what another
/// is making waits.
SharedFunction shared_function(const FunctionKey& key) {
  static std::mutex mutex;
  static std::list<std::pair<FunctionKey, std::shared_future<SharedFunction>>> recent;
  constexpr std::size_t kept = 256;
  std::promise<SharedFunction> promise;
  {
    std::unique_lock lock(mutex);
    for (auto entry = recent.begin(); entry != recent.end(); ++entry)
      if (entry->first == key) {
        recent.splice(recent.begin(), recent, entry);
        const std::shared_future<SharedFunction> found = entry->second;
        lock.unlock();
        return found.get();
      }
    recent.emplace_front(key, promise.get_future().share());
    if (recent.size() > kept) recent.pop_back();
  }
  try {
    auto made =
        std::make_shared<const PointSpreadFunction>(key.optics, key.step * defocus_step_um, key.blur_um);
    promise.set_value(made);
    return made;
  } catch (...) {
    promise.set_exception(std::current_exception());
    const std::lock_guard lock(mutex);
    recent.remove_if([&](const auto& entry) { return entry.first == key; });
    throw;
  }
}

}  // namespace

const PointSpreadFunction& PointSpreadFunctions::at(double defocus_um, double pupil_edge_loss) const {
  const std::pair steps(static_cast<int>(std::lround(defocus_um / defocus_step_um)),
                        static_cast<int>(std::lround(pupil_edge_loss / edge_loss_step)));
  const std::lock_guard lock(mutex_);
  auto& function = made_[steps];
  if (!function) {
    OpticsDescription optics = optics_;
    optics.pupil_edge_loss = steps.second * edge_loss_step;
    function = shared_function({optics, steps.first, blur_um_});
  }
  return *function;
}

double Landing::expected_electrons(const Emitter& emitter) const {
  if (window.global()) return emitter.emitted() * electrons_per_photon;
  // The shutter's time at the emitter's own row stands for the few rows of its image.
  const int row = static_cast<int>(std::floor(emitter.y_px + light->shift_y_px + 0.5)) - region.offset_y;
  return emitter.rate_hz * electrons_per_photon *
         window.overlap_s(std::clamp(row, 0, region.height - 1), window.light_begin_s + emitter.start_s,
                          window.light_begin_s + emitter.end_s);
}

PhotoElectrons Landing::draw(std::span<std::int64_t> detected, int threads) const {
  const EmitterLanding emitter_landing(*this, largest(light->response_ratio.get()));
  const int emitters = static_cast<int>(light->emitters->size());
  std::vector<std::vector<std::uint32_t>> landed(light->emitters->size());
  parallel_for(emitters, threads, 16, [&](int i) {
    emitter_landing.draw(i, landed[i]);
    detected[i] = static_cast<std::int64_t>(landed[i].size());
    emitter_landing.smear(i, landed[i]);
  });
  return by_row(landed, plane().rows);
}

void add_smear(std::span<float> pixels, Shape shape, const LightField& light) {
  const double above_share = light.smear_from_above, below_share = light.smear_from_below;
  const auto columns = static_cast<std::size_t>(shape.columns);
  std::vector<double> above(columns), below(columns);
  for (std::size_t i = 0; i < pixels.size(); ++i) below[i % columns] += static_cast<double>(pixels[i]);
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    const std::size_t c = i % columns;
    const auto own = static_cast<double>(pixels[i]);
    below[c] -= own;
    pixels[i] += static_cast<float>(above_share * above[c] + below_share * below[c] +
                                    std::max(above_share, below_share) * own);
    above[c] += own;
  }
}

void Landing::add_expected(PhotonImage& image) const {
  // Points and weights of Gauss-Hermite quadrature with five points, for a standard normal variable.
  constexpr double points[5] = {-2.8569700138728056, -1.3556261799742659, 0, 1.3556261799742659,
                                2.8569700138728056};
  constexpr double weights[5] = {0.011257411327720689, 0.22207592200561264, 0.53333333333333333,
                                 0.22207592200561264, 0.011257411327720689};
  PhotonImage atoms(image.shape());
  for (const Emitter& emitter : *light->emitters) {
    const double x = emitter.x_px + light->shift_x_px, y = emitter.y_px + light->shift_y_px;
    const double electrons = expected_electrons(emitter);
    const PointSpreadFunction& function = point_spread->at(emitter.defocus_um, light->pupil_edge_loss);
    const BlurAxes blur(emitter, pixels_per_um);
    const auto add = [&](double share, double dx, double dy) {
      function.add_expected(atoms, electrons * share, x + dx, y + dy, region.offset_x, region.offset_y,
                            binning_x, binning_y);
    };
    const double direct = 1 - light->halo_fraction;
    if (blur.none()) {
      add(direct, 0, 0);
    } else {
      for (int a = 0; a < 5; ++a)
        for (int b = 0; b < 5; ++b) {
          const double u = blur.major_px * points[a], v = blur.minor_px * points[b];
          add(direct * weights[a] * weights[b], blur.cosine * u - blur.sine * v,
              blur.sine * u + blur.cosine * v);
        }
    }
    if (light->halo_fraction > 0) {
      // The halo is smooth: 24 angles by 12 equally likely radii stand for it.
      constexpr int angles = 24, radii = 12;
      for (int a = 0; a < angles; ++a)
        for (int r = 0; r < radii; ++r) {
          const double radius = -light->halo_scale_px * math::log(1 - (r + 0.5) / radii);
          const double angle = (a + 0.5) / angles;
          add(light->halo_fraction / (angles * radii), radius * math::cos_turns(angle),
              radius * math::sin_turns(angle));
        }
    }
  }
  if (light->response_ratio)
    for (int row = 0; row < image.rows(); ++row)
      for (int column = 0; column < image.columns(); ++column)
        atoms(row, column) *= (*light->response_ratio)(row, column);
  if (light->smears()) add_smear(atoms.pixels(), atoms.shape(), *light);
  for (int row = 0; row < image.rows(); ++row)
    for (int column = 0; column < image.columns(); ++column) image(row, column) += atoms(row, column);
}

}  // namespace atomcam
