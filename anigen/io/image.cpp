#include "anigen/io/image.h"

#include <algorithm>
#include <cstdlib>
#include <new>
#include <optional>
#include <set>
#include <string_view>
#include <system_error>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/text.h"
#include "anigen/io/picture_codec.h"

namespace anigen::io {

namespace {

void refuse_size(std::uint64_t width, std::uint64_t height, const std::string& name) {
  if (width == 0 || height == 0) throw InputError(name, "", "picture without pixels");
  if (width <= kMostPixelsPerSide && height <= kMostPixelsPerSide) return;
  throw InputError(name, "",
                   "picture of " + std::to_string(width) + " x " + std::to_string(height) +
                       " pixels exceeds the limit of " + std::to_string(kMostPixelsPerSide) + " on a side");
}

void require_pixels(const Image& image) {
  const std::size_t expected = 4 * static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height);
  if (image.width > 0 && image.height > 0 && image.rgba.size() == expected) return;
  throw InputError("", "",
                   "picture of " + std::to_string(image.width) + " x " + std::to_string(image.height) +
                       " pixels with " + std::to_string(image.rgba.size()) + " bytes cannot be encoded");
}

/// Refuses what a header announces before anything is allocated for it.
void check_announced(const std::vector<std::uint8_t>& bytes, const std::string& name) {
  if (bytes.empty()) throw InputError(name, "", "picture of zero bytes");
  if (bytes.size() > std::size_t{1} << 30) throw InputError(name, "", "picture file larger than 1 GiB");
  const PictureSize announced = probe_picture(bytes, name);
  // Decoders would try dozens of other formats, down to DICOM, whose sizes nobody has checked.
  if (!announced.known)
    throw InputError(name, "",
                     "cannot be decoded as a picture: no PNG, JPEG, WebP, BMP or TIFF file, or a damaged one");
  refuse_size(announced.width, announced.height, name);
  if (!picture_codec().reads(announced.format))
    throw NotSupportedError(name, "", std::string(announced.format) + " pictures without OpenCV");
}

/// @param decode by a codec
template <typename Decode>
void decode_or_refuse(const std::string& name, Decode decode) {
  try {
    switch (decode()) {
      case PictureCodec::Outcome::kDone:
        return;
      case PictureCodec::Outcome::kOtherPixels:
        throw NotSupportedError(name, "", "this pixel type of a picture");
      case PictureCodec::Outcome::kDamaged:
        break;
    }
  } catch (const std::bad_alloc&) {
    throw InputError(name, "", "picture does not fit into memory");
  }
  throw InputError(name, "", "cannot be decoded as a picture: it is damaged");
}

std::vector<std::uint8_t> encoded_or_failed(std::vector<std::uint8_t> bytes, const char* format) {
  if (bytes.empty()) throw Error(std::string("cannot encode a picture as ") + format);
  return bytes;
}

}  // namespace

Image::Image(int width, int height, std::uint32_t rgba_fill) : width(width), height(height) {
  if (width < 0 || height < 0) throw InputError("", "", "a picture cannot have a negative size");
  rgba.resize(4 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  for (std::size_t i = 0; i < rgba.size(); ++i) rgba[i] = static_cast<std::uint8_t>(rgba_fill >> (24 - 8 * (i % 4)));
}

Image decode_image(const std::vector<std::uint8_t>& bytes, const std::string& name_for_errors, StoredPixels* stored) {
  check_announced(bytes, name_for_errors);
  Image image;
  StoredPixels found;
  decode_or_refuse(name_for_errors, [&] { return picture_codec().decode(bytes, image, found); });
  refuse_size(static_cast<std::uint64_t>(image.width), static_cast<std::uint64_t>(image.height), name_for_errors);
  if (stored != nullptr) *stored = found;
  return image;
}

Grey16 decode_grey16(const std::vector<std::uint8_t>& bytes, const std::string& name_for_errors) {
  check_announced(bytes, name_for_errors);
  Grey16 grey;
  StoredPixels found;
  decode_or_refuse(name_for_errors, [&] { return picture_codec().decode_grey16(bytes, grey, found); });
  if (found.channels != 1 || found.bits != 16)
    throw InputError(name_for_errors, "", "has other pixels than one channel of 16 bits");
  return grey;
}

Image read_image(const std::filesystem::path& path) {
  const std::string bytes = read_file(path, std::uintmax_t{1} << 30);
  return decode_image({bytes.begin(), bytes.end()}, path.string());
}

bool has_transparency(const Image& image) {
  for (std::size_t i = 3; i < image.rgba.size(); i += kImageChannels) {
    if (image.rgba[i] != 255) return true;
  }
  return false;
}

std::vector<std::filesystem::path> picture_files(const std::filesystem::path& folder) {
  static const std::set<std::string> kExtensions{".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff"};
  std::error_code error;
  std::vector<std::filesystem::path> pictures;
  for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
    std::error_code unreadable;
    if (entry.is_regular_file(unreadable) && kExtensions.count(lower_case(entry.path().extension().string())) > 0)
      pictures.push_back(entry.path());
  }
  if (error) throw InputError(folder.string(), "", "no folder that can be read");
  if (pictures.empty())
    throw InputError(folder.string(), "", "holds no picture (png, jpg, jpeg, webp, bmp, tif, tiff)");
  std::sort(pictures.begin(), pictures.end());
  return pictures;
}

std::vector<std::uint8_t> encode_png(const Image& image) {
  require_pixels(image);
  return encoded_or_failed(picture_codec().encode_png(image), "PNG");
}

std::vector<std::uint8_t> encode_png16(const Grey16& grey) {
  const std::size_t expected = static_cast<std::size_t>(grey.width) * static_cast<std::size_t>(grey.height);
  if (grey.width < 1 || grey.height < 1 || grey.values.size() != expected)
    throw InputError("", "", "a picture's values do not fit its size");
  return encoded_or_failed(picture_codec().encode_png16(grey), "PNG");
}

std::vector<std::uint8_t> encode_jpeg(const Image& image, int quality) {
  require_pixels(image);
  Image opaque = image;
  for (std::size_t i = 0; i < opaque.rgba.size(); i += kImageChannels) {
    std::uint8_t* pixel = opaque.rgba.data() + i;
    for (int c = 0; c < 3; ++c)
      pixel[c] = static_cast<std::uint8_t>((pixel[c] * pixel[3] + 255 * (255 - pixel[3]) + 127) / 255);
  }
  return encoded_or_failed(picture_codec().encode_jpeg(opaque, quality), "JPEG");
}

void write_png(const std::filesystem::path& path, const Image& image) {
  const std::vector<std::uint8_t> bytes = encode_png(image);
  write_file_atomically(path, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
}

namespace {

// The bytes of a picture file, read with a bounds check, so that every header can be walked without thinking about
// its end. Holds references only.
class PictureBytes {
 public:
  PictureBytes(const std::vector<std::uint8_t>& bytes, const std::string& name) : bytes_(bytes), name_(name) {}

  // @throws InputError naming the byte when the file ends before it; so does little_endian
  std::uint64_t big_endian(std::size_t at, std::size_t count) const {
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < count; ++i) value = value << 8 | byte(at + i);
    return value;
  }
  std::uint64_t little_endian(std::size_t at, std::size_t count) const {
    std::uint64_t value = 0;
    for (std::size_t i = count; i-- > 0;) value = value << 8 | byte(at + i);
    return value;
  }
  bool matches(std::size_t at, std::string_view text) const {
    return at + text.size() <= bytes_.size() &&
           std::equal(text.begin(), text.end(), bytes_.begin() + static_cast<std::ptrdiff_t>(at),
                      [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; });
  }
  std::size_t size() const { return bytes_.size(); }
  [[noreturn]] void truncated(std::size_t at) const {
    throw InputError(name_, "byte " + std::to_string(at), "picture file is cut short");
  }

 private:
  std::uint8_t byte(std::size_t at) const {
    if (at >= bytes_.size()) truncated(at);
    return bytes_[at];
  }
  const std::vector<std::uint8_t>& bytes_;
  const std::string& name_;
};

constexpr std::string_view kPngSignature = "\x89PNG\r\n\x1a\n", kJpegSignature = "\xff\xd8\xff";
constexpr std::uint64_t kTiffWidth = 256, kTiffHeight = 257, kTiffOrientation = 274;  // tags

constexpr std::size_t kEntryBytes = 12;

// Of an 8, 16 or 32 bit integer; 0 for other types.
std::size_t bytes_of_type(std::uint64_t type) { return type == 1 ? 1 : type == 3 ? 2 : type == 4 ? 4 : 0; }

// True where a classic TIFF header begins: of a TIFF file, or of the EXIF block inside another format.
bool is_tiff(const PictureBytes& in, std::size_t at) {
  return in.matches(at, {"II\x2a\0", 4}) || in.matches(at, {"MM\0\x2a", 4});
}

// The first value of an integer tag of the first directory (TIFF 6.0, section 2); nothing when the directory lacks the
// tag, or its value is no integer. @param at where the TIFF header begins
std::optional<std::uint64_t> tiff_value(const PictureBytes& in, std::size_t at, std::uint64_t tag) {
  const bool little = in.matches(at, "II");
  const auto value = [&](std::size_t place, std::size_t count) {
    return little ? in.little_endian(place, count) : in.big_endian(place, count);
  };
  const std::size_t directory = at + static_cast<std::size_t>(value(at + 4, 4));
  const std::uint64_t entries = value(directory, 2);
  for (std::uint64_t i = 0; i < entries; ++i) {
    const std::size_t entry = directory + 2 + kEntryBytes * static_cast<std::size_t>(i);
    if (value(entry, 2) != tag) continue;
    const std::size_t bytes = bytes_of_type(value(entry + 2, 2));  // tag, type, count, then the value itself
    if (bytes == 0) return std::nullopt;
    return value(entry + 8, bytes);
  }
  return std::nullopt;
}

PictureSize png_size(const PictureBytes& in) {
  // Chunks: length, type, data, checksum; the last one is IEND.
  for (std::size_t at = 8;; at += static_cast<std::size_t>(in.big_endian(at, 4)) + 12) {
    const std::uint64_t length = in.big_endian(at, 4);
    if (length > in.size() || at + length + 12 > in.size()) in.truncated(in.size());
    if (in.matches(at + 4, "IEND")) break;
  }
  return {true, in.big_endian(16, 4), in.big_endian(20, 4)};
}

PictureSize jpeg_size(const PictureBytes& in) {
  PictureSize size;
  std::size_t at = 2;
  while (true) {
    while (in.big_endian(at, 1) != 0xFF) ++at;  // stray bytes between segments are allowed
    while (in.big_endian(at, 1) == 0xFF) ++at;
    const std::uint64_t marker = in.big_endian(at++, 1);
    if (marker == 0xD9) return size;                                                 // end of image
    if (marker == 0 || marker == 1 || (marker >= 0xD0 && marker <= 0xD7)) continue;  // markers without a length
    const bool is_frame = marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC;
    if (is_frame) size = {true, in.big_endian(at + 5, 2), in.big_endian(at + 3, 2)};
    at += std::max<std::size_t>(2, static_cast<std::size_t>(in.big_endian(at, 2)));
  }
}

PictureSize bmp_size(const PictureBytes& in) {
  if (in.little_endian(14, 4) == 12) return {true, in.little_endian(18, 2), in.little_endian(20, 2)};
  const auto height = static_cast<std::int32_t>(in.little_endian(22, 4));  // negative: rows from the top
  return {true, in.little_endian(18, 4), static_cast<std::uint64_t>(std::abs(static_cast<std::int64_t>(height)))};
}

PictureSize webp_size(const PictureBytes& in) {
  if (in.matches(12, "VP8X")) return {true, in.little_endian(24, 3) + 1, in.little_endian(27, 3) + 1};
  if (in.matches(12, "VP8L")) {
    const std::uint64_t bits = in.little_endian(21, 4);
    return {true, (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1};
  }
  return {true, in.little_endian(26, 2) & 0x3FFF, in.little_endian(28, 2) & 0x3FFF};
}

PictureSize tiff_size(const PictureBytes& in) {
  const auto width = tiff_value(in, 0, kTiffWidth), height = tiff_value(in, 0, kTiffHeight);
  if (!width || !height) return {};
  return {true, *width, *height};
}

}  // namespace

PictureSize probe_picture(const std::vector<std::uint8_t>& bytes, const std::string& name_for_errors) {
  const PictureBytes in(bytes, name_for_errors);
  const auto named = [](PictureSize size, const char* format) {
    size.format = format;
    return size;
  };
  if (in.matches(0, kPngSignature)) return named(png_size(in), "PNG");
  if (in.matches(0, kJpegSignature)) return named(jpeg_size(in), "JPEG");
  if (in.matches(0, "BM")) return named(bmp_size(in), "BMP");
  if (in.matches(0, "RIFF") && in.matches(8, "WEBP")) return named(webp_size(in), "WebP");
  if (is_tiff(in, 0)) return named(tiff_size(in), "TIFF");
  return {};
}

namespace {

constexpr std::string_view kExifPrefix{"Exif\0\0", 6};
constexpr int kUpright = 1, kOrientations = 8;

// Start of the EXIF block: its TIFF header.
std::optional<std::size_t> in_jpeg(const PictureBytes& in) {
  for (std::size_t at = 2; in.big_endian(at, 1) == 0xFF;) {
    const std::uint64_t marker = in.big_endian(at + 1, 1);
    if (marker == 0xFF) {  // a fill byte
      ++at;
      continue;
    }
    if (marker == 0xDA || marker == 0xD9) return std::nullopt;  // the picture itself begins, or ends
    if (marker == 0xE1 && in.matches(at + 4, kExifPrefix)) return at + 4 + kExifPrefix.size();
    at += 2 + static_cast<std::size_t>(in.big_endian(at + 2, 2));
  }
  return std::nullopt;
}

std::optional<std::size_t> in_png(const PictureBytes& in) {
  for (std::size_t at = kPngSignature.size(); at < in.size();) {
    if (in.matches(at + 4, "eXIf")) return at + 8;
    at += static_cast<std::size_t>(in.big_endian(at, 4)) + 12;  // length, type, data, checksum
  }
  return std::nullopt;
}

std::optional<std::size_t> in_webp(const PictureBytes& in) {
  for (std::size_t at = 12; at + 8 <= in.size();) {
    if (in.matches(at, "EXIF")) {
      const std::size_t block = at + 8;
      return in.matches(block, kExifPrefix) ? block + kExifPrefix.size() : block;  // some writers keep JPEG's prefix
    }
    const auto length = static_cast<std::size_t>(in.little_endian(at + 4, 4));
    at += 8 + length + length % 2;
  }
  return std::nullopt;
}

std::optional<std::size_t> exif_block(const PictureBytes& in) {
  if (in.matches(0, kJpegSignature)) return in_jpeg(in);
  if (in.matches(0, kPngSignature)) return in_png(in);
  if (in.matches(0, "RIFF") && in.matches(8, "WEBP")) return in_webp(in);
  return std::nullopt;
}

}  // namespace

int exif_orientation(const std::vector<std::uint8_t>& bytes) {
  const std::string no_name;
  const PictureBytes in(bytes, no_name);
  try {
    const std::optional<std::size_t> block = exif_block(in);
    if (!block || !is_tiff(in, *block)) return kUpright;
    const std::uint64_t value = tiff_value(in, *block, kTiffOrientation).value_or(kUpright);
    return value >= 1 && value <= kOrientations ? static_cast<int>(value) : kUpright;
  } catch (const InputError&) {
    return kUpright;  // a damaged remark is no reason to refuse a picture
  }
}

Image upright(const Image& stored, int orientation) {
  if (orientation < 1 || orientation > kOrientations)
    throw InputError("", "", "orientation " + std::to_string(orientation) + " of a picture; EXIF has 1 … 8");
  if (orientation == kUpright) return stored;
  const bool exchanged = orientation >= 5;
  const bool from_right = orientation == 2 || orientation == 3 || orientation == 7 || orientation == 8;
  const bool from_below = orientation == 3 || orientation == 4 || orientation == 6 || orientation == 7;
  Image result(exchanged ? stored.height : stored.width, exchanged ? stored.width : stored.height);
  for (int y = 0; y < result.height; ++y) {
    for (int x = 0; x < result.width; ++x) {
      const int across = exchanged ? y : x, down = exchanged ? x : y;
      const std::uint8_t* from =
          stored.pixel(from_right ? stored.width - 1 - across : across, from_below ? stored.height - 1 - down : down);
      std::copy_n(from, kImageChannels, result.pixel(x, y));
    }
  }
  return result;
}

}  // namespace anigen::io
