#include "tests/support/picture_files.h"

#include <zlib.h>

#include <algorithm>
#include <cstdlib>
#include <string>

namespace anigen::test {
namespace {

void put(FileBytes& bytes, std::uint64_t value, int count, bool big_endian) {
  for (int i = 0; i < count; ++i)
    bytes.push_back(static_cast<std::uint8_t>(value >> (8 * (big_endian ? count - 1 - i : i))));
}

void append(FileBytes& bytes, const FileBytes& more) { bytes.insert(bytes.end(), more.begin(), more.end()); }

FileBytes letters(const std::string& text) { return {text.begin(), text.end()}; }

FileBytes png_chunk(const std::string& type, const FileBytes& data) {
  FileBytes checked = letters(type);
  append(checked, data);
  FileBytes chunk;
  put(chunk, data.size(), 4, true);
  append(chunk, checked);
  put(chunk, crc32(0, checked.data(), static_cast<uInt>(checked.size())), 4, true);
  return chunk;
}

FileBytes jpeg_segment(int marker, const FileBytes& data) {
  FileBytes segment{0xFF, static_cast<std::uint8_t>(marker)};
  put(segment, data.size() + 2, 2, true);
  append(segment, data);
  return segment;
}

struct TiffEntry {
  int tag, type;
  std::uint32_t value;
};

// Header, then one directory of single values. @param data_tag its value becomes the place after the directory
FileBytes tiff_header(const std::vector<TiffEntry>& entries, int data_tag, bool big_endian) {
  FileBytes bytes = letters(big_endian ? "MM" : "II");
  put(bytes, 42, 2, big_endian);
  put(bytes, 8, 4, big_endian);
  put(bytes, entries.size(), 2, big_endian);
  const std::size_t end = 8 + 2 + 12 * entries.size() + 4;
  for (const TiffEntry& entry : entries) {
    put(bytes, static_cast<std::uint64_t>(entry.tag), 2, big_endian);
    put(bytes, static_cast<std::uint64_t>(entry.type), 2, big_endian);
    put(bytes, 1, 4, big_endian);
    const int used = entry.type == 3 ? 2 : 4;
    put(bytes, entry.tag == data_tag ? end : entry.value, used, big_endian);
    put(bytes, 0, 4 - used, big_endian);
  }
  put(bytes, 0, 4, big_endian);
  return bytes;
}

constexpr int kShort = 3, kLong = 4;

}  // namespace

FileBytes exif_block(int orientation, bool big_endian) {
  return tiff_header({{274, kShort, static_cast<std::uint32_t>(orientation)}}, 0, big_endian);
}

FileBytes jpeg_with_exif(const FileBytes& jpeg, const FileBytes& exif) {
  FileBytes data = letters("Exif");
  data.insert(data.end(), 2, 0);
  append(data, exif);
  FileBytes result(jpeg.begin(), jpeg.begin() + 2);
  append(result, jpeg_segment(0xE1, data));
  result.insert(result.end(), jpeg.begin() + 2, jpeg.end());
  return result;
}

FileBytes png_with_exif(const FileBytes& png, const FileBytes& exif) {
  constexpr std::ptrdiff_t kAfterHeader = 8 + 12 + 13;  // signature, the chunk IHDR
  FileBytes result(png.begin(), png.begin() + kAfterHeader);
  append(result, png_chunk("eXIf", exif));
  result.insert(result.end(), png.begin() + kAfterHeader, png.end());
  return result;
}

FileBytes palette_png(const std::array<std::uint8_t, 4>& left, const std::array<std::uint8_t, 4>& right) {
  FileBytes header;
  put(header, 2, 4, true);
  put(header, 1, 4, true);
  append(header, {8, 3, 0, 0, 0});  // 8 bit, palette
  const FileBytes rows{0, 0, 1};    // no filter, entries 0 and 1
  FileBytes packed(compressBound(rows.size()));
  uLongf length = packed.size();
  if (compress(packed.data(), &length, rows.data(), rows.size()) != Z_OK) std::abort();
  packed.resize(length);
  FileBytes png{0x89, 'P', 'N', 'G', '\r', '\n', 0x1A, '\n'};
  append(png, png_chunk("IHDR", header));
  append(png, png_chunk("PLTE", {left[0], left[1], left[2], right[0], right[1], right[2]}));
  append(png, png_chunk("tRNS", {left[3], right[3]}));
  append(png, png_chunk("IDAT", packed));
  append(png, png_chunk("IEND", {}));
  return png;
}

FileBytes cmyk_jpeg(const std::array<std::uint8_t, 4>& inks) {
  FileBytes jpeg{0xFF, 0xD8};
  FileBytes adobe = letters("Adobe");
  append(adobe, {0, 100, 0, 0, 0, 0, 0});  // version, flags, no colour transform
  append(jpeg, jpeg_segment(0xEE, adobe));
  FileBytes quantization(65, 8);  // a step of 8: a mean of one block is stored in ones
  quantization[0] = 0;
  append(jpeg, jpeg_segment(0xDB, quantization));
  append(jpeg, jpeg_segment(0xC0, {8, 0, 8, 0, 8, 4, 1, 0x11, 0, 2, 0x11, 0, 3, 0x11, 0, 4, 0x11, 0}));
  // Means: nine codes of four bits for differences of 0 … 8 bits. The rest of a block: "0" ends it.
  append(jpeg, jpeg_segment(0xC4, {0x00, 0, 0, 0, 9, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8}));
  append(jpeg, jpeg_segment(0xC4, {0x10, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}));
  append(jpeg, jpeg_segment(0xDA, {4, 1, 0, 2, 0, 3, 0, 4, 0, 0, 63, 0}));
  std::string bits;
  const auto write = [&bits](int value, int count) {
    for (int i = count; i-- > 0;) bits += (value >> i & 1) != 0 ? '1' : '0';
  };
  for (const std::uint8_t ink : inks) {
    const int mean = ink - 128;
    int size = 0;
    while (std::abs(mean) >> size != 0) ++size;
    write(size, 4);
    write(mean < 0 ? mean + (1 << size) - 1 : mean, size);
    write(0, 1);
  }
  while (bits.size() % 8 != 0) bits += '1';
  for (std::size_t i = 0; i < bits.size(); i += 8) {
    jpeg.push_back(static_cast<std::uint8_t>(std::stoi(bits.substr(i, 8), nullptr, 2)));
    if (jpeg.back() == 0xFF) jpeg.push_back(0);
  }
  append(jpeg, {0xFF, 0xD9});
  return jpeg;
}

FileBytes grey_tiff(std::uint32_t width, std::uint32_t height, const FileBytes& pixels, int orientation) {
  constexpr int kStrip = 273;
  FileBytes tiff = tiff_header({{256, kLong, width},
                                {257, kLong, height},
                                {258, kShort, 8},
                                {259, kShort, 1},
                                {262, kShort, 1},
                                {kStrip, kLong, 0},
                                {274, kShort, static_cast<std::uint32_t>(orientation)},
                                {277, kShort, 1},
                                {278, kLong, height},
                                {279, kLong, width * height}},
                               kStrip, false);
  append(tiff, pixels);
  return tiff;
}

}  // namespace anigen::test
