#include <zlib.h>
#include <algorithm>
#include <array>
#include <cstdlib>
#include <memory>

#define STB_IMAGE_STATIC
#define STB_IMAGE_IMPLEMENTATION
#define STBI_ONLY_PNG
#define STBI_ONLY_JPEG
#define STBI_ONLY_BMP
#define STBI_NO_STDIO
#define STBI_NO_FAILURE_STRINGS
#include <stb/stb_image.h>
#define STB_IMAGE_WRITE_STATIC
#define STB_IMAGE_WRITE_IMPLEMENTATION
#define STBI_WRITE_NO_STDIO
#include <stb/stb_image_write.h>

#include "anigen/core/error.h"
#include "anigen/io/picture_codec.h"

namespace anigen::io {

namespace stb {

using Outcome = PictureCodec::Outcome;

struct Free {
  void operator()(void* pixels) const { std::free(pixels); }
};

int length_of(const std::vector<std::uint8_t>& bytes) { return static_cast<int>(bytes.size()); }

/// Before anything is allocated: a header may hide the size that stb takes from the one that image.h looks at.
bool is_too_large(const std::vector<std::uint8_t>& bytes) {
  int width = 0, height = 0, channels = 0;
  return stbi_info_from_memory(bytes.data(), length_of(bytes), &width, &height, &channels) != 0 &&
         std::max(width, height) > kMostPixelsPerSide;
}

bool has_16_bits(const std::vector<std::uint8_t>& bytes) {
  return stbi_is_16_bit_from_memory(bytes.data(), length_of(bytes)) != 0;
}

/// @param to_byte of one stored value
template <typename Value, typename ToByte>
void fill(Image& image, const Value* from, int channels, ToByte to_byte) {
  for (std::size_t i = 0; i < image.rgba.size(); i += kImageChannels, from += channels) {
    std::uint8_t* pixel = image.rgba.data() + i;
    for (int c = 0; c < 3; ++c) pixel[c] = to_byte(from[channels >= 3 ? c : 0]);
    if (channels == 4 || channels == 2) pixel[3] = to_byte(from[channels - 1]);
  }
}

bool reads(std::string_view format) { return format == "PNG" || format == "JPEG" || format == "BMP"; }

Outcome decode(const std::vector<std::uint8_t>& bytes, Image& image, StoredPixels& stored) {
  if (is_too_large(bytes)) return Outcome::kDamaged;
  int width = 0, height = 0, channels = 0;
  if (has_16_bits(bytes)) {
    const std::unique_ptr<stbi_us, Free> pixels(
        stbi_load_16_from_memory(bytes.data(), length_of(bytes), &width, &height, &channels, 0));
    if (!pixels) return Outcome::kDamaged;
    image = Image(width, height);
    fill(image, pixels.get(), channels, [](int value) { return static_cast<std::uint8_t>((value + 128) / 257); });
    stored = {channels, 16};
    return Outcome::kDone;
  }
  const std::unique_ptr<stbi_uc, Free> pixels(
      stbi_load_from_memory(bytes.data(), length_of(bytes), &width, &height, &channels, 0));
  if (!pixels) return Outcome::kDamaged;
  image = Image(width, height);
  fill(image, pixels.get(), channels, [](std::uint8_t value) { return value; });
  stored = {channels, 8};
  return Outcome::kDone;
}

Outcome decode_grey16(const std::vector<std::uint8_t>& bytes, Grey16& grey, StoredPixels& stored) {
  if (is_too_large(bytes)) return Outcome::kDamaged;
  int width = 0, height = 0, channels = 0;
  const std::unique_ptr<stbi_us, Free> pixels(
      stbi_load_16_from_memory(bytes.data(), length_of(bytes), &width, &height, &channels, 0));
  if (!pixels) return Outcome::kDamaged;
  stored = {channels, has_16_bits(bytes) ? 16 : 8};
  grey = {width, height, {}};
  if (channels != 1 || stored.bits != 16) return Outcome::kDone;
  grey.values.assign(pixels.get(), pixels.get() + static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  return Outcome::kDone;
}

using Row = std::vector<std::uint8_t>;

void append_big_endian(Row& to, std::uint32_t value) {
  for (int shift = 24; shift >= 0; shift -= 8) to.push_back(static_cast<std::uint8_t>(value >> shift));
}

void append_chunk(Row& file, const char* type, const Row& data) {
  append_big_endian(file, static_cast<std::uint32_t>(data.size()));
  const std::size_t start = file.size();
  file.insert(file.end(), type, type + 4);
  file.insert(file.end(), data.begin(), data.end());
  append_big_endian(
      file, static_cast<std::uint32_t>(::crc32_z(0, file.data() + start, static_cast<z_size_t>(file.size() - start))));
}

int paeth(int left, int above, int before) {
  const int guess = left + above - before;
  const int to_left = std::abs(guess - left), to_above = std::abs(guess - above), to_before = std::abs(guess - before);
  if (to_left <= to_above && to_left <= to_before) return left;
  return to_above <= to_before ? above : before;
}

/// A row by one of PNG's filters 0 … 4, behind the filter's number (PNG specification, section 9).
void filter_row(int filter, const Row& row, const Row& above, std::size_t pixel, Row& result) {
  result.assign(1, static_cast<std::uint8_t>(filter));
  for (std::size_t i = 0; i < row.size(); ++i) {
    const int a = i < pixel ? 0 : row[i - pixel], b = above[i], c = i < pixel ? 0 : above[i - pixel];
    const int guess = filter == 0 ? 0 : filter == 1 ? a : filter == 2 ? b : filter == 3 ? (a + b) / 2 : paeth(a, b, c);
    result.push_back(static_cast<std::uint8_t>(row[i] - guess));
  }
}

/// Sum of a filtered row's bytes as signed numbers: the least promises the smallest file.
std::size_t weight(const Row& filtered) {
  std::size_t sum = 0;
  for (std::size_t i = 1; i < filtered.size(); ++i) sum += std::min<std::size_t>(filtered[i], 256U - filtered[i]);
  return sum;
}

/// @param pixel its bytes @param color_type of the PNG specification, section 11.2.2
/// @param row_of fills the bytes of row y
template <typename RowOf>
Row png_file(int width, int height, std::size_t pixel, int bits, int color_type, RowOf row_of) {
  Row filtered;
  Row row(pixel * static_cast<std::size_t>(width)), above(row.size(), 0), candidate, best;
  filtered.reserve((row.size() + 1) * static_cast<std::size_t>(height));
  for (int y = 0; y < height; ++y) {
    row_of(y, row);
    for (int filter = 0; filter <= 4; ++filter) {
      filter_row(filter, row, above, pixel, candidate);
      if (filter == 0 || weight(candidate) < weight(best)) std::swap(candidate, best);
    }
    filtered.insert(filtered.end(), best.begin(), best.end());
    std::swap(row, above);
  }
  constexpr int kLevel = 4;
  Row packed(::compressBound(filtered.size()));
  uLongf length = packed.size();
  if (::compress2(packed.data(), &length, filtered.data(), filtered.size(), kLevel) != Z_OK) return {};
  packed.resize(length);

  Row file = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'}, header;
  append_big_endian(header, static_cast<std::uint32_t>(width));
  append_big_endian(header, static_cast<std::uint32_t>(height));
  for (const int value : {bits, color_type, 0, 0, 0}) header.push_back(static_cast<std::uint8_t>(value));
  append_chunk(file, "IHDR", header);
  append_chunk(file, "IDAT", packed);
  append_chunk(file, "IEND", {});
  return file;
}

std::vector<std::uint8_t> encode_png(const Image& image) {
  constexpr int kColorAndAlpha = 6;
  return png_file(image.width, image.height, kImageChannels, 8, kColorAndAlpha,
                  [&](int y, Row& row) { std::copy_n(image.pixel(0, y), row.size(), row.begin()); });
}

std::vector<std::uint8_t> encode_png16(const Grey16& grey) {
  constexpr int kGrey = 0;
  return png_file(grey.width, grey.height, 2, 16, kGrey, [&](int y, Row& row) {
    const std::uint16_t* from = grey.values.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(grey.width);
    for (std::size_t i = 0; i < row.size(); i += 2, ++from) {
      row[i] = static_cast<std::uint8_t>(*from >> 8);
      row[i + 1] = static_cast<std::uint8_t>(*from & 255);
    }
  });
}

std::vector<std::uint8_t> encode_jpeg(const Image& image, int quality) {
  std::vector<std::uint8_t> colors;
  colors.reserve(image.rgba.size() / kImageChannels * 3);
  for (std::size_t i = 0; i < image.rgba.size(); i += kImageChannels)
    colors.insert(colors.end(), image.rgba.begin() + static_cast<std::ptrdiff_t>(i),
                  image.rgba.begin() + static_cast<std::ptrdiff_t>(i) + 3);
  std::vector<std::uint8_t> bytes;
  const auto append = [](void* to, void* data, int size) {
    const auto* from = static_cast<const std::uint8_t*>(data);
    static_cast<std::vector<std::uint8_t>*>(to)->insert(static_cast<std::vector<std::uint8_t>*>(to)->end(), from,
                                                        from + size);
  };
  if (stbi_write_jpg_to_func(append, &bytes, image.width, image.height, 3, colors.data(), quality) == 0) return {};
  return bytes;
}

}  // namespace stb

const PictureCodec& stb_codec() {
  static constexpr PictureCodec kCodec{stb::reads,      stb::decode,       stb::decode_grey16,
                                       stb::encode_png, stb::encode_png16, stb::encode_jpeg};
  return kCodec;
}

}  // namespace anigen::io
