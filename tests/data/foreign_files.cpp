#include "data/foreign_files.hpp"

#include <fitsio.h>
#include <fmt/format.h>
#include <hdf5.h>
#include <tiffio.h>
#include <zip.h>

#include "data/pixels.hpp"
#include "support/temporary_folder.hpp"

namespace atomcam {
namespace {

using Path = std::filesystem::path;
using enum PixelType;
const std::vector<PixelType> all_types = {uint8, int8,   uint16, int16,   uint32,
                                          int32, uint64, int64,  float32, float64};

std::string text_of(const std::vector<std::byte>& bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

std::string all_frames(PixelType type, StackShape shape) {
  std::string bytes;
  for (std::uint64_t n = 0; n < shape.frames; ++n) bytes += text_of(some_pixels(type, shape.pixels(), n));
  return bytes;
}

template <int compression>
void write_tiff(const Path& file, PixelType type, StackShape shape) {
  TIFF* tiff = TIFFOpen(file.c_str(), "w");
  for (std::uint64_t n = 0; n < shape.frames; ++n) {
    auto pixels = some_pixels(type, shape.pixels(), n);
    TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, shape.columns);
    TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, shape.rows);
    TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, static_cast<int>(8 * bytes_of(type)));
    TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT,
                 type == float32 || type == float64                                ? SAMPLEFORMAT_IEEEFP
                 : type == int8 || type == int16 || type == int32 || type == int64 ? SAMPLEFORMAT_INT
                                                                                   : SAMPLEFORMAT_UINT);
    TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
    TIFFSetField(tiff, TIFFTAG_COMPRESSION, compression);
    TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, shape.rows);
    TIFFWriteEncodedStrip(tiff, 0, pixels.data(), static_cast<tmsize_t>(pixels.size()));
    TIFFWriteDirectory(tiff);
  }
  TIFFClose(tiff);
}

std::string npy(PixelType type, StackShape shape) {
  const std::string code =
      fmt::format("{}{}{}", bytes_of(type) == 1 ? '|' : '<', name_of(type)[0], bytes_of(type));
  std::string header = fmt::format("{{'descr': '{}', 'fortran_order': False, 'shape': ({}, {}, {}), }}", code,
                                   shape.frames, shape.rows, shape.columns);
  header.resize(117, ' ');
  header += '\n';
  return std::string("\x93NUMPY\x01\x00\x76\x00", 10) + header + all_frames(type, shape);
}

void write_npy(const Path& file, PixelType type, StackShape shape) {
  write_bytes(file, npy(type, shape));
}

template <int method>
void write_npz(const Path& file, PixelType type, StackShape shape) {
  const std::string bytes = npy(type, shape);
  zip_t* zip = zip_open(file.c_str(), ZIP_CREATE | ZIP_TRUNCATE, nullptr);
  const auto index = zip_file_add(zip, "arr_0.npy", zip_source_buffer(zip, bytes.data(), bytes.size(), 0), 0);
  zip_set_file_compression(zip, static_cast<zip_uint64_t>(index), method, 0);
  zip_close(zip);
}

hid_t stored(PixelType type) {
  switch (type) {
    case uint8:
      return H5T_STD_U8LE;
    case int8:
      return H5T_STD_I8LE;
    case uint16:
      return H5T_STD_U16LE;
    case int16:
      return H5T_STD_I16LE;
    case uint32:
      return H5T_STD_U32LE;
    case int32:
      return H5T_STD_I32LE;
    case uint64:
      return H5T_STD_U64LE;
    case int64:
      return H5T_STD_I64LE;
    case float32:
      return H5T_IEEE_F32LE;
    default:
      return H5T_IEEE_F64LE;
  }
}

/// As labscript does: groups on the way, one dataset; the library's oldest format or the one with checksums.
template <bool checksums, bool chunks>
void write_hdf5(const Path& file, PixelType type, StackShape shape) {
  H5dont_atexit();  // damaged files can leave identifiers that its cleaning up at exit trips over
  const hid_t access = H5Pcreate(H5P_FILE_ACCESS);
  if (checksums) H5Pset_libver_bounds(access, H5F_LIBVER_V18, H5F_LIBVER_LATEST);
  const hid_t hdf5 = H5Fcreate(file.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, access);
  const hid_t links = H5Pcreate(H5P_LINK_CREATE);
  H5Pset_create_intermediate_group(links, 1);
  const hsize_t size[3] = {shape.frames, static_cast<hsize_t>(shape.rows),
                           static_cast<hsize_t>(shape.columns)};
  const hid_t space = H5Screate_simple(3, size, nullptr);
  const hid_t properties = H5Pcreate(H5P_DATASET_CREATE);
  if (chunks) {
    const hsize_t chunk[3] = {2, size[1], 16};
    H5Pset_chunk(properties, 3, chunk);
    H5Pset_deflate(properties, 4);
  }
  const hid_t set =
      H5Dcreate2(hdf5, "images/side/fluorescence/atoms", stored(type), space, links, properties, H5P_DEFAULT);
  const std::string bytes = all_frames(type, shape);
  H5Dwrite(set, stored(type), H5S_ALL, H5S_ALL, H5P_DEFAULT, bytes.data());
  H5Dclose(set), H5Pclose(properties), H5Sclose(space), H5Pclose(links), H5Fclose(hdf5), H5Pclose(access);
}

int fits_image(PixelType type) {
  switch (type) {
    case uint8:
      return BYTE_IMG;
    case int8:
      return SBYTE_IMG;
    case uint16:
      return USHORT_IMG;
    case int16:
      return SHORT_IMG;
    case uint32:
      return ULONG_IMG;
    case int32:
      return LONG_IMG;
    case int64:
      return LONGLONG_IMG;
    case float32:
      return FLOAT_IMG;
    default:
      return DOUBLE_IMG;
  }
}
int fits_memory(PixelType type) {
  switch (type) {
    case uint8:
      return TBYTE;
    case int8:
      return TSBYTE;
    case uint16:
      return TUSHORT;
    case int16:
      return TSHORT;
    case uint32:
      return TUINT;
    case int32:
      return TINT;
    case int64:
      return TLONGLONG;
    case float32:
      return TFLOAT;
    default:
      return TDOUBLE;
  }
}

/// A cube, or an image extension for each frame.
template <bool cube>
void write_fits(const Path& file, PixelType type, StackShape shape) {
  fitsfile* fits = nullptr;
  int status = 0;
  std::filesystem::remove(file);
  fits_create_diskfile(&fits, file.c_str(), &status);
  LONGLONG size[3] = {shape.columns, shape.rows, static_cast<LONGLONG>(shape.frames)};
  double exposure = 0.03;
  if (!cube) fits_create_img(fits, BYTE_IMG, 0, nullptr, &status);
  for (std::uint64_t n = 0; n < shape.frames; ++n) {
    auto pixels = some_pixels(type, shape.pixels(), n);
    if (n == 0 || !cube) {
      fits_create_imgll(fits, fits_image(type), cube ? 3 : 2, size, &status);
      fits_update_key(fits, TDOUBLE, "EXPTIME", &exposure, "seconds", &status);
    }
    const auto count = static_cast<LONGLONG>(shape.pixels());
    fits_write_img(fits, fits_memory(type), (cube ? static_cast<LONGLONG>(n) * count : 0) + 1, count,
                   pixels.data(), &status);
    if (!cube) fits_write_chksum(fits, &status);
  }
  if (cube) fits_write_chksum(fits, &status);
  fits_close_file(fits, &status);
}

template <int version>
void write_sif(const Path& file, PixelType type, StackShape shape) {
  std::string text = "Andor Technology Multi-Channel File\n65538 1\n";
  text += std::to_string(version) + " 0 0 1 1701175930 -80 ";
  text += std::string("\0 \0 \0 \1 \0 ", 10);
  text += "0 0.0145 0.0296 0.0296 1 ";
  text += std::string("\0 ", 2) +
          "0.0296 1e-07 0 1 56 0 0 1e-08 0 0\nDU897_BV \n 512 512 9\nstack.sif \n65538 2048\n";
  text += std::string(2048, '\0') + "\n65538 \1 \2 \3 \0 0 0\n65540 0 0 500 0 0 1200 1200\n";
  const std::uint64_t pixels = shape.pixels();
  text += fmt::format("12\nPixel number6\nCounts12\nPixel number65541 1 512 512 1 {} 1 {} {}\n", shape.frames,
                      pixels * shape.frames, pixels);
  text += fmt::format("65538 3 {} {} 5 2 1 0\n", 4 + 2 * shape.rows, 2 + shape.columns);
  for (std::uint64_t n = 0; n < shape.frames; ++n) text += fmt::format("{:10}\n", 29600 * n);
  if (version >= 65560) text += "0\n";
  write_bytes(file, text + all_frames(type, shape) + "0\n0\n");
}

template <class Value>
void put(std::string& bytes, std::size_t at, Value value) {
  std::memcpy(bytes.data() + at, &value, sizeof value);
}

/// Format 0x1000000 with the footers of Camera Link, or 0x2000000 with those of USB.
template <bool camera_link>
void write_dcimg(const Path& file, PixelType type, StackShape shape) {
  constexpr std::uint32_t session = 232, data = 1000, footer = camera_link ? 32 : 16;
  const auto depth = static_cast<std::uint32_t>(bytes_of(type));
  const auto columns = static_cast<std::uint32_t>(shape.columns),
             rows = static_cast<std::uint32_t>(shape.rows);
  const auto frames = static_cast<std::uint32_t>(shape.frames);
  const std::uint32_t row_bytes = columns * depth + 4, image = row_bytes * rows;
  std::string bytes(session + data, '\0');
  bytes.replace(0, 5, "DCIMG");
  put(bytes, 8, std::uint32_t{camera_link ? 0x1000000 : 0x2000000});
  put(bytes, 36, frames);
  put(bytes, 40, session);
  put(bytes, 48, std::uint64_t{session + data} + std::uint64_t{frames} * (image + footer));
  put(bytes, session + 60, frames);
  put(bytes, session + 64, depth);
  put(bytes, session + 72, columns);
  put(bytes, session + 76, rows);
  put(bytes, session + 80, row_bytes);
  put(bytes, session + 84, image);
  put(bytes, session + 96, std::uint64_t{data});
  put(bytes, session + 124, footer);
  put(bytes, session + 714, static_cast<std::uint16_t>(columns));
  put(bytes, session + 716, std::uint16_t{1020});  // row 1023 of the sensor is row 3 here
  for (std::uint32_t n = 0; n < frames; ++n) {
    const std::string pixels = text_of(some_pixels(type, shape.pixels(), n));
    std::string frame;
    for (std::uint32_t r = 0; r < rows; ++r)
      frame += pixels.substr(r * columns * depth, columns * depth) + std::string(4, '\7');
    frame += std::string(footer, '\0');
    put(frame, image, n);
    put(frame, image + 4, std::uint32_t{100 + n});
    put(frame, image + 8, std::uint32_t{250000});
    if (camera_link) {
      frame.replace(image + 12, 8, frame.substr(3 * row_bytes, 8));
      frame.replace(3 * row_bytes, 8, 8, '\xee');
    }
    bytes += frame;
  }
  write_bytes(file, bytes);
}

/// Format 7: the pixels set aside, here of the first row, and the times stand behind all frames.
void write_old_dcimg(const Path& file, PixelType type, StackShape shape) {
  constexpr std::uint32_t session = 232, data = 800, second = 1000;
  const auto depth = static_cast<std::uint32_t>(bytes_of(type));
  const auto columns = static_cast<std::uint32_t>(shape.columns),
             rows = static_cast<std::uint32_t>(shape.rows);
  const auto frames = static_cast<std::uint32_t>(shape.frames);
  const std::uint32_t row_bytes = columns * depth, image = row_bytes * rows;
  std::string bytes(session + data, '\0');
  for (std::uint32_t n = 0; n < frames; ++n) {
    std::string frame = text_of(some_pixels(type, shape.pixels(), n));
    frame.replace(0, 8, 8, '\xee');
    bytes += frame;
  }
  const auto footer = static_cast<std::uint32_t>(bytes.size());
  constexpr std::uint32_t aside = second + 200;
  bytes.resize(footer + aside + 8 * frames);
  bytes.replace(0, 5, "DCIMG");
  put(bytes, 8, std::uint32_t{7});
  put(bytes, 36, frames);
  put(bytes, 40, session);
  put(bytes, 48, std::uint64_t{bytes.size()});
  put(bytes, session + 32, frames);
  put(bytes, session + 36, depth);
  put(bytes, session + 44, columns);
  put(bytes, session + 48, row_bytes);
  put(bytes, session + 52, rows);
  put(bytes, session + 56, image);
  put(bytes, session + 68, data);
  put(bytes, session + 72, std::uint64_t{footer - session});
  put(bytes, footer + 8, std::uint64_t{second});
  put(bytes, footer + 40, aside + 8 * frames);
  put(bytes, footer + second + 88, std::uint64_t{aside});
  for (std::uint32_t n = 0; n < frames; ++n) {
    put(bytes, footer + 272 + 4 * frames + 8 * n, std::uint32_t{100 + n});
    bytes.replace(footer + aside + 8 * n, 8, text_of(some_pixels(type, shape.pixels(), n)).substr(0, 8));
  }
  write_bytes(file, bytes);
}

}  // namespace

const std::vector<ForeignFormat>& foreign_formats() {
  const std::vector<PixelType> fits_types = {uint8, int8,  uint16,  int16,  uint32,
                                             int32, int64, float32, float64};
  static const std::vector<ForeignFormat> formats = {
      {"tiff", all_types, write_tiff<COMPRESSION_NONE>},
      {"tiff_deflate", all_types, write_tiff<COMPRESSION_ADOBE_DEFLATE>},
      {"tiff_lzw", all_types, write_tiff<COMPRESSION_LZW>},
      {"npy", all_types, write_npy},
      {"npz", all_types, write_npz<ZIP_CM_STORE>},
      {"npz_deflate", all_types, write_npz<ZIP_CM_DEFLATE>},
      {"hdf5", all_types, write_hdf5<false, false>},
      {"hdf5_checksums", all_types, write_hdf5<true, false>},
      {"hdf5_deflate", all_types, write_hdf5<false, true>},
      {"fits", fits_types, write_fits<true>},
      {"fits_sequence", fits_types, write_fits<false>},
      {"sif", {float32}, write_sif<65559>},
      {"sif_with_flag", {float32}, write_sif<65567>},
      {"dcimg", {uint8, uint16}, write_dcimg<true>},
      {"dcimg_old", {uint8, uint16}, write_old_dcimg},
      {"dcimg_usb", {uint8, uint16}, write_dcimg<false>},
  };
  return formats;
}

}  // namespace atomcam
