// Rows and columns that move together from frame to frame.

#include <cmath>

#include "analysis/family.hpp"
#include "analysis/lanes.hpp"

namespace atomcam::analysis {
namespace {

ATOMCAM_VECTOR_CLONES
void line_sums(const Plane& plane, float* rows, float* columns) {
  const PlaneShape& shape = plane.shape();
  for (std::ptrdiff_t c = 0; c < shape.stride; c += static_cast<std::ptrdiff_t>(lane_count))
    store(columns + c, lanes(0));
  for (int r = 0; r < shape.rows; ++r) {
    const float* p = plane.row(r);
    Lanes sum = lanes(0);
    for (std::ptrdiff_t c = 0; c < shape.stride; c += static_cast<std::ptrdiff_t>(lane_count)) {
      const Lanes v = load(p + c);
      sum += v;
      store(columns + c, load(columns + c) + v);
    }
    rows[r] = static_cast<float>(total(sum));
  }
}

/// Sums over the lines of one direction: square, products with the next line and the eighth next, what
/// alternates, product with the same line a frame earlier; and the largest line in its own noise.
struct LineSums {
  enum { square, next, eighth, odd, before, before_square, white, count };
  std::array<double, count> sums{};
  double largest = 0;
  LineSums& operator+=(const LineSums& other) {
    for (std::size_t k = 0; k < sums.size(); ++k) sums[k] += other.sums[k];
    largest = std::max(largest, other.largest);
    return *this;
  }
};

class Lines : public Family {
 public:
  explicit Lines(const Layout& layout) : layout_(layout) {
    const auto rows = static_cast<std::size_t>(layout.shape.rows),
               columns = static_cast<std::size_t>(layout.shape.columns);
    for (auto& line : row_sums_) line.resize(rows);
    for (auto& line : column_sums_) line.resize(static_cast<std::size_t>(layout.shape.stride));
    row_weight_.resize(rows);
    column_weight_.resize(columns);
    row_square_.resize(rows);
    column_square_.resize(columns);
    for (int r = 0; r < layout.shape.rows; ++r)
      for (int c = 0; c < layout.shape.columns; ++c) {
        const double a = static_cast<double>(layout.quiet.at(r, c));
        row_weight_[static_cast<std::size_t>(r)] += a;
        column_weight_[static_cast<std::size_t>(c)] += a;
        row_square_[static_cast<std::size_t>(r)] += a * a;
        column_square_[static_cast<std::size_t>(c)] += a * a;
      }
  }

  void second_look(const SecondLook& look) override {
    const std::size_t now = look.frame % 2, then = 1 - now;
    line_sums(look.quiet, row_sums_[now].data(), column_sums_[now].data());
    double level = 0;
    for (const float sum : row_sums_[now]) level += static_cast<double>(sum);
    level /= layout_.quiet_sum;
    take(row_sums_[now], row_sums_[then], row_weight_, row_square_, level, look, row_[look.part]);
    take(column_sums_[now], column_sums_[then], column_weight_, column_square_, level, look,
         column_[look.part]);
  }

  void summarise(Part which, const Record&, Sheet& sheet) const override {
    sheet.family("lines");
    const auto put = [&](const LineSums& lines, std::string_view name, std::string_view observable) {
      sheet.kind({observable, "time", name});
      const auto& s = lines.sums;
      sheet.put(name, "variance", std::log(s[LineSums::square] / s[LineSums::white]));
      sheet.put(name, "next", s[LineSums::next] / s[LineSums::square]);
      sheet.put(name, "eighth", s[LineSums::eighth] / s[LineSums::square]);
      sheet.put(name, "odd", std::log(s[LineSums::odd] / s[LineSums::square] + 1e-3));
      sheet.put(name, "frame_before", s[LineSums::before] / s[LineSums::before_square]);
      sheet.put_unsteady(name, "largest", std::log(lines.largest));
    };
    put(row_.of(which), "rows", "row_means");
    put(column_.of(which), "columns", "column_means");
  }

 private:
  /// Takes the frame's level away from the line sums and adds up.
  void take(Floats& now, const Floats& then, const std::vector<double>& weight,
            const std::vector<double>& square, double level, const SecondLook& look, LineSums& to) {
    const std::size_t n = weight.size();
    double sum = 0, next = 0, eighth = 0, odd = 0, before = 0;
    for (std::size_t i = 0; i < n; ++i) {
      // Each line as if it had the same noise.
      const double v = (static_cast<double>(now[i]) - level * weight[i]) / std::sqrt(square[i] + 1e-9);
      now[i] = static_cast<float>(v);
      sum += v * v;
      to.largest = std::max(to.largest, std::abs(v));
      if (i >= 1) next += v * static_cast<double>(now[i - 1]);
      if (i >= 8) eighth += v * static_cast<double>(now[i - 8]);
      odd += i % 2 ? v : -v;
      before += v * static_cast<double>(then[i]);
    }
    auto& s = to.sums;
    s[LineSums::square] += sum;
    s[LineSums::next] += next;
    s[LineSums::eighth] += eighth;
    s[LineSums::odd] += odd * odd;
    if (look.before) {
      s[LineSums::before] += before;
      s[LineSums::before_square] += sum;
    }
    s[LineSums::white] += static_cast<double>(n);
  }

  const Layout& layout_;
  std::array<Floats, 2> row_sums_, column_sums_;
  std::vector<double> row_weight_, column_weight_, row_square_, column_square_;
  Halves<LineSums> row_, column_;
};

}  // namespace

std::unique_ptr<Family> make_lines(const Layout& layout) {
  return std::make_unique<Lines>(layout);
}

}  // namespace atomcam::analysis
