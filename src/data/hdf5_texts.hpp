#pragma once
// Texts of variable length in an HDF5 file, read by hand: the library (1.10) trusts what a damaged heap says
// about their sizes, and crashes. Layout after the HDF5 File Format Specification, sections III.E (global
// heap) and IV.A.2.d (variable-length types).

#include "data/file.hpp"
#include "data/hdf5_handle.hpp"

namespace atomcam {

class Hdf5Texts {
 public:
  Hdf5Texts(const Path& file, hid_t hdf5);
  /// Whether there is a dataset of this name whose texts can be read: not compressed, of one axis or none.
  bool has(const char* dataset) const;
  /// Text number `index`; empty beyond the last.
  std::string read(const char* dataset, std::uint64_t index);

 private:
  std::uint64_t number(std::uint64_t at, std::size_t bytes);
  [[noreturn]] void damaged(const char* dataset) const;

  Path name_;
  hid_t hdf5_;
  File file_;
  std::uint64_t size_ = 0;
  bool known_ = false;  // addresses and lengths of 8 bytes, nothing before the library's part
};

}  // namespace atomcam
