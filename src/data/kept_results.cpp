#include "data/kept_results.hpp"

#include <dlfcn.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <fstream>

#include "data/file_hash.hpp"

namespace atomcam {
namespace {

namespace fs = std::filesystem;
constexpr std::string_view magic = "atomcam kept 1\n\n";
constexpr std::uint64_t largest_side = 1u << 30;

std::string digest_of(std::string_view bytes) {
  Sha256 hash;
  hash.add(bytes.data(), bytes.size());
  return hash.digits();
}

/// The file that this code was loaded from: another build may simulate otherwise.
std::string program_digest() {
  Dl_info info{};
  std::string file = "/proc/self/exe";
  if (dladdr(reinterpret_cast<const void*>(&program_digest), &info) && info.dli_fname &&
      std::string_view(info.dli_fname).find(".so") != std::string_view::npos)
    file = info.dli_fname;
  return sha256_of(file);
}

void put(std::string& bytes, std::uint64_t number) {
  bytes.append(reinterpret_cast<const char*>(&number), sizeof number);
}

/// Takes what was put off the front of the bytes.
bool take(std::string_view& bytes, std::uint64_t& number) {
  if (bytes.size() < sizeof number) return false;
  std::memcpy(&number, bytes.data(), sizeof number);
  bytes.remove_prefix(sizeof number);
  return true;
}

std::string packed(const Matrices& matrices) {
  std::string bytes;
  put(bytes, matrices.size());
  for (const Eigen::MatrixXd& one : matrices) {
    put(bytes, static_cast<std::uint64_t>(one.rows()));
    put(bytes, static_cast<std::uint64_t>(one.cols()));
    bytes.append(reinterpret_cast<const char*>(one.data()),
                 sizeof(double) * static_cast<std::size_t>(one.size()));
  }
  return bytes;
}

std::optional<Matrices> unpacked(std::string_view bytes) {
  std::uint64_t count = 0;
  if (!take(bytes, count) || count > 16) return std::nullopt;
  Matrices matrices;
  for (std::uint64_t k = 0; k < count; ++k) {
    std::uint64_t rows = 0, columns = 0;
    if (!take(bytes, rows) || !take(bytes, columns) || rows > largest_side || columns > largest_side ||
        bytes.size() / sizeof(double) < rows * columns)
      return std::nullopt;
    Eigen::MatrixXd one(static_cast<Eigen::Index>(rows), static_cast<Eigen::Index>(columns));
    const std::size_t size = sizeof(double) * rows * columns;
    if (size > 0) std::memcpy(one.data(), bytes.data(), size);
    bytes.remove_prefix(size);
    matrices.push_back(std::move(one));
  }
  if (!bytes.empty()) return std::nullopt;
  return matrices;
}

}  // namespace

ResultKey& ResultKey::add(std::string_view text) {
  add(text.size());
  hash_.add(text.data(), text.size());
  return *this;
}
ResultKey& ResultKey::add(std::uint64_t number) {
  hash_.add(&number, sizeof number);
  return *this;
}
ResultKey& ResultKey::add(const Eigen::MatrixXd& values) {
  add(static_cast<std::uint64_t>(values.rows())).add(static_cast<std::uint64_t>(values.cols()));
  hash_.add(values.data(), sizeof(double) * static_cast<std::size_t>(values.size()));
  return *this;
}

KeptResults::KeptResults(fs::path folder, std::string common) : folder_(std::move(folder)) {
  static const std::string program = program_digest();
  common_ = program + common;
  std::error_code ignored;
  fs::create_directories(folder_, ignored);
}

fs::path KeptResults::file_of(ResultKey key) const {
  return folder_ / (key.add(common_).digits() + ".kept");
}

std::optional<Matrices> KeptResults::find(ResultKey key) const {
  const fs::path file = file_of(std::move(key));
  std::ifstream in(file, std::ios::binary);
  if (!in) return std::nullopt;
  const std::string bytes(std::istreambuf_iterator<char>(in), {});
  std::string_view rest = bytes;
  constexpr std::size_t digits = 64;
  if (!rest.starts_with(magic) || rest.size() < magic.size() + digits) return std::nullopt;
  rest.remove_prefix(magic.size());
  const std::string_view digest = rest.substr(0, digits);
  rest.remove_prefix(digits);
  if (digest != digest_of(rest)) return std::nullopt;
  std::error_code ignored;
  fs::last_write_time(file, fs::file_time_type::clock::now(), ignored);
  return unpacked(rest);
}

void KeptResults::keep(ResultKey key, const Matrices& matrices) const {
  const fs::path file = file_of(std::move(key));
  const fs::path unfinished = file.string() + "." + std::to_string(getpid());
  const std::string bytes = packed(matrices);
  std::ofstream out(unfinished, std::ios::binary);
  out << magic << digest_of(bytes) << bytes;
  out.close();
  std::error_code error;
  if (out) fs::rename(unfinished, file, error);
  if (!out || error) fs::remove(unfinished, error);
}

void KeptResults::trim(std::uintmax_t bytes) const {
  struct Entry {
    fs::file_time_type used;
    std::uintmax_t size;
    fs::path file;
  };
  std::vector<Entry> entries;
  std::uintmax_t total = 0;
  std::error_code error;
  for (fs::directory_iterator at(folder_, error), end; !error && at != end; at.increment(error)) {
    std::error_code gone;
    if (at->path().extension() != ".kept") continue;
    const Entry one{at->last_write_time(gone), at->file_size(gone), at->path()};
    if (gone) continue;
    entries.push_back(one);
    total += one.size;
  }
  std::sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) { return a.used < b.used; });
  for (const Entry& one : entries) {
    if (total <= bytes) break;
    fs::remove(one.file, error);
    total -= one.size;
  }
}

}  // namespace atomcam
