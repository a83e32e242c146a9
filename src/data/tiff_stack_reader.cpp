#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cstring>
#include <nlohmann/json.hpp>

#include "data/file.hpp"
#include "data/tiff_chain.hpp"
#include "data/tiff_handle.hpp"

namespace atomcam {
namespace {

constexpr std::uint32_t micro_manager_tag = 51123;     // JSON about the page
constexpr std::uint64_t most_compressed_ratio = 2048;  // of deflate and LZW, rounded up

std::optional<double> number_in(std::string_view text) {
  double value = 0;
  while (!text.empty() && (text.front() == ' ' || text.front() == '"')) text.remove_prefix(1);
  const auto [end, problem] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (problem != std::errc{}) return std::nullopt;
  return value;
}

/// `text` from behind `start` to `end`; empty if there is none.
std::string_view between(std::string_view text, std::string_view start, std::string_view end) {
  const auto from = text.find(start);
  if (from == text.npos) return {};
  const auto to = text.find(end, from + start.size());
  return text.substr(from + start.size(), to == text.npos ? to : to - from - start.size());
}

/// Value of an attribute of one XML element.
std::string_view attribute(std::string_view element, std::string_view name) {
  return between(element, " " + std::string(name) + "=\"", "\"");
}

struct Page {
  std::uint32_t rows = 0, columns = 0;
  PixelType type = PixelType::uint16;
  std::uint16_t compression = COMPRESSION_NONE;
  bool operator==(const Page&) const = default;
};

class TiffStackReader : public StackReader {
 public:
  explicit TiffStackReader(const Path& file)
      // c, m: strips as they are, no memory map (which a file cut off meanwhile would turn into a crash)
      : StackReader(file), chain_(tiff_chain(file)), tiff_(file, "rcm") {
    std::uint64_t end = chain_.end;
    for (std::uint64_t n = 0; n < chain_.offsets.size(); ++n) {
      go(n);
      const Page page = describe(n);
      if (n == 0) {
        page_ = page;
        set_shape(chain_.offsets.size(), page.rows, page.columns, page.type);
      } else if (page.rows != page_.rows || page.columns != page_.columns) {
        fail(n, fmt::format("{} x {} pixels, where frame 0 has {} x {}", page.rows, page.columns, page_.rows,
                            page_.columns));
      } else if (page.type != page_.type) {
        fail(n, fmt::format("{}, where frame 0 is {}", name_of(page.type), name_of(page_.type)));
      }
      end = std::max(end, check_pixels(n, page));
      note_page(n);
    }
    if (metadata_.timestamps_s.size() != chain_.offsets.size()) metadata_.timestamps_s.clear();
    go(0);
    const std::string first = description();
    if (first.starts_with("{\"lab\":"))
      set_notes(parse_notes(file, first.substr(0, first.find(",\"truth\":")) + "}"));
    if (first.starts_with("ImageJ=")) {
      read_imagej(first);
    } else if (const auto pixels = between(first, "<Pixels", ">"); !pixels.empty()) {
      read_ome(first, pixels);
    } else if (chain_.file_size - end >= shape_.pixels() * bytes_of(type_)) {
      fail(fmt::format("pages are missing: {} are linked, but {} bytes follow the last one", frames(),
                       chain_.file_size - end));
    }
  }

  std::string truth(std::uint64_t frame) override {
    if (contiguous_) return "null";
    if (frame >= frames()) fail(fmt::format("frame {} is not in it, it has {}", frame, frames()));
    go(frame);
    const std::string text = description();
    // The first key "truth" outside of strings: the notes before it hold none.
    for (const std::string_view start : {"{\"truth\":", ",\"truth\":"}) {
      const auto at = text.find(start);
      if (at != text.npos && text.front() == '{' && text.back() == '}')
        return text.substr(at + start.size(), text.size() - 1 - at - start.size());
    }
    return "null";
  }

 private:
  void go(std::uint64_t frame) {
    errno = 0;
    if (TIFFSetSubDirectory(tiff_.get(), chain_.offsets[frame]) != 1)
      fail(frame, cannot("read", errno, tiff_.complaint()));
  }
  std::string description() const {
    const char* text = nullptr;
    return TIFFGetField(tiff_.get(), TIFFTAG_IMAGEDESCRIPTION, &text) == 1 && text ? text : "";
  }

  Page describe(std::uint64_t frame) {
    TIFF* tiff = tiff_.get();
    Page page;
    std::uint16_t bits = 1, samples = 1, format = SAMPLEFORMAT_UINT;
    TIFFGetField(tiff, TIFFTAG_IMAGEWIDTH, &page.columns);
    TIFFGetField(tiff, TIFFTAG_IMAGELENGTH, &page.rows);
    TIFFGetFieldDefaulted(tiff, TIFFTAG_BITSPERSAMPLE, &bits);
    TIFFGetFieldDefaulted(tiff, TIFFTAG_SAMPLESPERPIXEL, &samples);
    TIFFGetFieldDefaulted(tiff, TIFFTAG_SAMPLEFORMAT, &format);
    TIFFGetFieldDefaulted(tiff, TIFFTAG_COMPRESSION, &page.compression);
    if (samples != 1) fail(frame, fmt::format("{} samples per pixel; 1 can be read", samples));
    constexpr std::uint16_t known[] = {COMPRESSION_NONE,          COMPRESSION_LZW,  COMPRESSION_DEFLATE,
                                       COMPRESSION_ADOBE_DEFLATE, COMPRESSION_LZMA, COMPRESSION_ZSTD,
                                       COMPRESSION_PACKBITS};
    if (std::ranges::find(known, page.compression) == std::end(known))
      fail(frame, fmt::format("compression {}; none, LZW, deflate, PackBits, LZMA and Zstandard can be read",
                              page.compression));
    struct Kind {
      std::uint16_t bits, format;
      PixelType type;
    };
    constexpr Kind kinds[] = {
        {8, SAMPLEFORMAT_UINT, PixelType::uint8},      {8, SAMPLEFORMAT_INT, PixelType::int8},
        {16, SAMPLEFORMAT_UINT, PixelType::uint16},    {16, SAMPLEFORMAT_INT, PixelType::int16},
        {32, SAMPLEFORMAT_UINT, PixelType::uint32},    {32, SAMPLEFORMAT_INT, PixelType::int32},
        {64, SAMPLEFORMAT_UINT, PixelType::uint64},    {64, SAMPLEFORMAT_INT, PixelType::int64},
        {32, SAMPLEFORMAT_IEEEFP, PixelType::float32}, {64, SAMPLEFORMAT_IEEEFP, PixelType::float64},
    };
    if (format == SAMPLEFORMAT_VOID) format = SAMPLEFORMAT_UINT;
    for (const Kind& kind : kinds) {
      if (kind.bits == bits && kind.format == format) {
        page.type = kind.type;
        return page;
      }
    }
    fail(frame, fmt::format("{} bits per pixel of sample format {}; integers of 8, 16, 32 or 64 bits and "
                            "floating point of 32 or 64 can be read",
                            bits, format));
  }

  /// Where the pixels of the page end in the file.
  std::uint64_t check_pixels(std::uint64_t frame, const Page& page) {
    TIFF* tiff = tiff_.get();
    std::uint64_t *offsets = nullptr, *sizes = nullptr;
    const bool tiled = TIFFIsTiled(tiff);
    if (TIFFGetField(tiff, tiled ? TIFFTAG_TILEOFFSETS : TIFFTAG_STRIPOFFSETS, &offsets) != 1 || !offsets ||
        TIFFGetField(tiff, tiled ? TIFFTAG_TILEBYTECOUNTS : TIFFTAG_STRIPBYTECOUNTS, &sizes) != 1 || !sizes)
      fail(frame, "no pixels");
    const std::uint32_t pieces = tiled ? TIFFNumberOfTiles(tiff) : TIFFNumberOfStrips(tiff);
    std::uint64_t end = 0, stored = 0;
    for (std::uint32_t i = 0; i < pieces; ++i) {
      if (offsets[i] > chain_.file_size || sizes[i] > chain_.file_size - offsets[i])
        fail(frame, "its pixels lie beyond the end of the file; cut off?");
      end = std::max(end, offsets[i] + sizes[i]);
      stored += sizes[i];
    }
    const std::uint64_t bytes = shape_.pixels() * bytes_of(page.type);
    if (page.compression == COMPRESSION_NONE && !tiled) {
      // Some writers round each strip up to a whole word; one that notes a whole ImageJ stack here has one
      // page.
      if (stored < bytes || (stored > bytes + 3 * std::uint64_t{pieces} && chain_.offsets.size() > 1) ||
          (stored > bytes + 3 * std::uint64_t{pieces} && stored % bytes != 0))
        fail(frame, fmt::format("{} bytes of pixels, where {} x {} of {} need {}", stored, page.rows,
                                page.columns, name_of(page.type), bytes));
    } else if (bytes / most_compressed_ratio > stored) {
      fail(frame, fmt::format("{} bytes cannot hold {} x {} pixels", stored, page.rows, page.columns));
    }
    return end;
  }

  /// What Micro-Manager writes about each page.
  void note_page(std::uint64_t frame) {
    std::uint32_t count = 0;
    const char* text = nullptr;
    if (TIFFGetField(tiff_.get(), micro_manager_tag, &count, &text) != 1 || !text || count == 0) return;
    const auto json = nlohmann::json::parse(std::string_view(text, strnlen(text, count)), nullptr, false);
    if (!json.is_object()) return;
    const auto number = [&](const char* key) -> std::optional<double> {
      const auto found = json.find(key);
      if (found == json.end()) return std::nullopt;
      if (found->is_number()) return found->get<double>();
      return found->is_string() ? number_in(found->get_ref<const std::string&>()) : std::nullopt;
    };
    if (const auto elapsed = number("ElapsedTime-ms"); elapsed && metadata_.timestamps_s.size() == frame)
      metadata_.timestamps_s.push_back(*elapsed / 1000);
    if (frame > 0) return;
    if (const auto exposure = number("Exposure-ms")) metadata_.exposure_s = *exposure / 1000;
    if (const auto camera = json.find("Camera"); camera != json.end() && camera->is_string())
      metadata_.camera = *camera;
  }

  /// ImageJ writes a stack above 4 GB as one page with all planes behind its first.
  void read_imagej(const std::string& text) {
    for (std::size_t at = 0; at < text.size();) {
      const std::size_t end = std::min(text.find('\n', at), text.size());
      const std::string line = text.substr(at, end - at);
      if (const auto equal = line.find('='); equal != line.npos)
        metadata_.others[line.substr(0, equal)] = line.substr(equal + 1);
      at = end + 1;
    }
    std::uint64_t images = 1;
    if (const auto found = metadata_.others.find("images"); found != metadata_.others.end()) {
      const auto [end, problem] =
          std::from_chars(found->second.data(), found->second.data() + found->second.size(), images);
      if (problem != std::errc{} || images == 0) fail("ImageJ notes images=" + found->second);
    }
    if (images == frames()) return;
    if (frames() != 1) fail(fmt::format("ImageJ notes {} images; there are {} pages", images, frames()));
    std::uint64_t* offsets = nullptr;
    if (page_.compression != COMPRESSION_NONE || TIFFIsTiled(tiff_.get()) ||
        TIFFGetField(tiff_.get(), TIFFTAG_STRIPOFFSETS, &offsets) != 1 || !offsets)
      fail(fmt::format("ImageJ notes {} images; there is 1 page", images));
    contiguous_ = offsets[0];
    const std::uint64_t bytes = shape_.pixels() * bytes_of(type_);
    const std::uint64_t whole = (chain_.file_size - *contiguous_) / bytes;
    if (whole < images)
      fail(whole, fmt::format("the file ends in it; ImageJ notes {} images; cut off?", images));
    set_shape(images, page_.rows, page_.columns, page_.type);
    raw_.emplace(file_, "rb");
  }

  void read_ome(const std::string& text, std::string_view pixels) {
    const auto size = [&](const char* name) { return number_in(attribute(pixels, name)).value_or(1); };
    if (size("SizeX") != shape_.columns || size("SizeY") != shape_.rows)
      fail(fmt::format("OME notes {} x {} pixels; the pages have {} x {}", size("SizeY"), size("SizeX"),
                       shape_.rows, shape_.columns));
    const double planes = size("SizeC") * size("SizeZ") * size("SizeT");
    // Several files can share one description, and one file can hold several images.
    const bool alone =
        text.find("FileName=") == text.npos && text.find("<Pixels", text.find("<Pixels") + 1) == text.npos;
    if (alone && planes != static_cast<double>(frames()))
      fail(fmt::format("OME notes {} planes; there are {} pages", planes, frames()));
    std::vector<double> times;
    for (std::size_t at = text.find("<Plane "); at != text.npos; at = text.find("<Plane ", at + 1)) {
      const std::string_view plane = std::string_view(text).substr(at, text.find('>', at) - at);
      const double scale = attribute(plane, "DeltaTUnit") == "ms" ? 1e-3 : 1;
      if (const auto time = number_in(attribute(plane, "DeltaT"))) times.push_back(*time * scale);
      const double exposure_scale = attribute(plane, "ExposureTimeUnit") == "ms" ? 1e-3 : 1;
      if (const auto exposure = number_in(attribute(plane, "ExposureTime")))
        metadata_.exposure_s = *exposure * exposure_scale;
    }
    if (times.size() == frames()) metadata_.timestamps_s = std::move(times);
  }

  void fetch(std::uint64_t frame, std::span<std::byte> pixels) override {
    if (contiguous_) return fetch_plane(frame, pixels);
    go(frame);
    if (TIFFIsTiled(tiff_.get())) return fetch_tiles(frame, pixels);
    const auto strip = static_cast<std::size_t>(TIFFStripSize(tiff_.get()));
    for (std::uint32_t s = 0; s < TIFFNumberOfStrips(tiff_.get()); ++s) {
      if (s * strip >= pixels.size()) fail(frame, "more strips than rows");
      const auto room = static_cast<tmsize_t>(std::min(strip, pixels.size() - s * strip));
      if (TIFFReadEncodedStrip(tiff_.get(), s, pixels.data() + s * strip, room) != room)
        fail(frame, cannot("read", errno, tiff_.complaint()));
    }
  }

  void fetch_tiles(std::uint64_t frame, std::span<std::byte> pixels) {
    std::uint32_t width = 0, height = 0;
    TIFFGetField(tiff_.get(), TIFFTAG_TILEWIDTH, &width);
    TIFFGetField(tiff_.get(), TIFFTAG_TILELENGTH, &height);
    const std::size_t pixel = bytes_of(type_);
    const auto rows = static_cast<std::uint32_t>(shape_.rows),
               columns = static_cast<std::uint32_t>(shape_.columns);
    const auto size = TIFFTileSize(tiff_.get());
    if (width == 0 || height == 0 || size != static_cast<tmsize_t>(pixel * width * height) ||
        static_cast<std::uint64_t>(size) > 4 * pixels.size() + (1 << 24))
      fail(frame, fmt::format("tiles of {} x {} pixels", height, width));
    std::vector<std::byte> tile(static_cast<std::size_t>(size));
    for (std::uint32_t row = 0; row < rows; row += height) {
      for (std::uint32_t column = 0; column < columns; column += width) {
        if (TIFFReadTile(tiff_.get(), tile.data(), column, row, 0, 0) != size)
          fail(frame, cannot("read", errno, tiff_.complaint()));
        for (std::uint32_t r = 0; r < std::min(height, rows - row); ++r)
          std::memcpy(pixels.data() + (std::size_t{row + r} * columns + column) * pixel,
                      tile.data() + std::size_t{r} * width * pixel,
                      std::min(width, columns - column) * pixel);
      }
    }
  }

  void fetch_plane(std::uint64_t frame, std::span<std::byte> pixels) {
    raw_->seek(static_cast<std::int64_t>(*contiguous_ + frame * pixels.size()));
    if (!raw_->read(pixels)) fail(frame, "the file ends in it; cut off?");
    if (!chain_.big_endian) return;
    const std::size_t pixel = bytes_of(type_);
    for (std::size_t i = 0; i < pixels.size(); i += pixel)
      std::reverse(pixels.begin() + static_cast<std::ptrdiff_t>(i),
                   pixels.begin() + static_cast<std::ptrdiff_t>(i + pixel));
  }

  TiffChain chain_;
  Tiff tiff_;
  Page page_;
  std::optional<std::uint64_t> contiguous_;  // where ImageJ's planes begin
  std::optional<File> raw_;
};

}  // namespace

std::unique_ptr<StackReader> read_tiff(const Path& file) {
  return std::make_unique<TiffStackReader>(file);
}

}  // namespace atomcam
