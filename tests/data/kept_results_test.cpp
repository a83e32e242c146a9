// Results on disk: what was kept comes back bit by bit, what was damaged does not come back.

#include "data/kept_results.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "support/temporary_folder.hpp"

namespace atomcam {
namespace {

namespace fs = std::filesystem;

Matrices some() {
  Eigen::MatrixXd one(2, 3);
  one << 1, 2, 3, 4, std::nan(""), -0.0;
  return {one, Eigen::MatrixXd(0, 4), Eigen::MatrixXd::Constant(1, 1, 1e-300)};
}
ResultKey key(double value) {
  ResultKey key;
  key.add("a step").add(std::uint64_t{7}).add(Eigen::MatrixXd::Constant(1, 1, value));
  return key;
}
fs::path only_file(const fs::path& folder) {
  return fs::directory_iterator(folder)->path();
}

TEST(KeptResults, ComeBackBitByBit) {
  const TemporaryFolder folder;
  const KeptResults results(folder.path(), "frames");
  EXPECT_FALSE(results.find(key(1)));
  results.keep(key(1), some());
  const auto found = results.find(key(1));
  ASSERT_TRUE(found);
  ASSERT_EQ(found->size(), 3u);
  const Matrices expected = some();
  for (std::size_t k = 0; k < expected.size(); ++k) {
    ASSERT_EQ((*found)[k].rows(), expected[k].rows());
    ASSERT_EQ((*found)[k].cols(), expected[k].cols());
    if (expected[k].size() == 0) continue;  // has no data to point to
    EXPECT_EQ(0, std::memcmp((*found)[k].data(), expected[k].data(),
                             sizeof(double) * static_cast<std::size_t>(expected[k].size())));
  }
}

TEST(KeptResults, DependOnTheKeyAndOnWhatAllShare) {
  const TemporaryFolder folder;
  const KeptResults results(folder.path(), "frames");
  results.keep(key(1), some());
  EXPECT_FALSE(results.find(key(1.0000001)));
  EXPECT_FALSE(KeptResults(folder.path(), "other frames").find(key(1)));
  EXPECT_TRUE(KeptResults(folder.path(), "frames").find(key(1)));
}

TEST(KeptResults, DamagedOnesAreNone) {
  const TemporaryFolder folder;
  const KeptResults results(folder.path(), "frames");
  results.keep(key(1), some());
  const fs::path file = only_file(folder.path());
  const auto size = fs::file_size(file);
  for (const std::uintmax_t at : {std::uintmax_t{0}, size / 2, size - 1}) {
    std::fstream bytes(file, std::ios::in | std::ios::out | std::ios::binary);
    bytes.seekg(static_cast<std::streamoff>(at));
    const char old = static_cast<char>(bytes.get());
    bytes.seekp(static_cast<std::streamoff>(at));
    bytes.put(static_cast<char>(old ^ 1));
    bytes.close();
    EXPECT_FALSE(results.find(key(1))) << "byte " << at;
    bytes.open(file, std::ios::in | std::ios::out | std::ios::binary);
    bytes.seekp(static_cast<std::streamoff>(at));
    bytes.put(old);
    bytes.close();
    EXPECT_TRUE(results.find(key(1)));
  }
  fs::resize_file(file, size - 8);
  EXPECT_FALSE(results.find(key(1)));
  fs::resize_file(file, 0);
  EXPECT_FALSE(results.find(key(1)));
}

TEST(KeptResults, TheLongestUnusedGoFirst) {
  const TemporaryFolder folder;
  const KeptResults results(folder.path(), "frames");
  results.keep(key(1), some());
  const auto size = fs::file_size(only_file(folder.path()));
  fs::last_write_time(only_file(folder.path()), fs::file_time_type::clock::now() - std::chrono::hours(2));
  results.keep(key(2), some());
  results.trim(2 * size);
  EXPECT_TRUE(results.find(key(1)));  // which also makes it the last used
  results.keep(key(3), some());
  for (const auto& entry : fs::directory_iterator(folder.path()))
    fs::last_write_time(entry.path(), fs::file_time_type::clock::now() - std::chrono::hours(1));
  EXPECT_TRUE(results.find(key(2)));
  results.trim(size);
  EXPECT_FALSE(results.find(key(1)));
  EXPECT_TRUE(results.find(key(2)));
  EXPECT_FALSE(results.find(key(3)));
}

TEST(KeptResults, AFolderThatCannotBeWrittenKeepsNothing) {
  const KeptResults results("/proc/nowhere", "frames");
  results.keep(key(1), some());
  EXPECT_FALSE(results.find(key(1)));
}

}  // namespace
}  // namespace atomcam
