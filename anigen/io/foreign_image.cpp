#include "anigen/io/foreign_image.h"

#include <algorithm>
#include <cstring>
#include <string_view>

#include "anigen/core/error.h"
#include "anigen/core/guarded_reader.h"
#include "anigen/io/picture_codec.h"

namespace anigen::io {

namespace {

constexpr double kDecoderSeconds = 20.0, kPixelsPerSecond = 4e6;
/// Of the decoder's picture (up to 16 bytes a pixel), ours (4) and the answer (4), each with a copy on the way.
constexpr std::uint64_t kBytesPerPixel = 48, kDecoderBytes = std::uint64_t{512} << 20;

/// Begins an answer; the pixels follow it.
struct PictureHead {
  StoredPixels stored;
  int width = 0, height = 0;
};

std::string decoded_answer(const std::vector<std::uint8_t>& bytes) {
  PictureHead head;
  const Image image = decode_image(bytes, "", &head.stored);
  head.width = image.width;
  head.height = image.height;
  std::string answer(sizeof head + image.rgba.size(), '\0');
  std::memcpy(answer.data(), &head, sizeof head);
  std::memcpy(answer.data() + sizeof head, image.rgba.data(), image.rgba.size());
  return answer;
}

}  // namespace

Image decode_foreign_image(const std::vector<std::uint8_t>& bytes, const std::string& name_for_errors,
                           StoredPixels* stored) {
  // The header alone tells whether there is anything to decode.
  const PictureSize announced = probe_picture(bytes, name_for_errors);
  if (!announced.known || announced.width > kMostPixelsPerSide || announced.height > kMostPixelsPerSide)
    return decode_image(bytes, name_for_errors, stored);  // refuses it
  const std::uint64_t pixels = announced.width * announced.height;
  ProcessLimits limits;
  limits.cpu_seconds = kDecoderSeconds + static_cast<double>(pixels) / kPixelsPerSecond;
  limits.more_memory = kDecoderBytes + kBytesPerPixel * pixels + 2 * bytes.size();
  limits.sandbox = SandboxRights{};  // it has the bytes, and answers by the pipe
  picture_codec();                   // loaded here, once, and not by each of the processes
  const std::string answer =
      read_guarded(name_for_errors, "cannot be decoded as a picture: the decoder %; the file is damaged or hostile",
                   limits, [&bytes] { return decoded_answer(bytes); });
  PictureHead head;
  std::memcpy(&head, answer.data(), std::min(sizeof head, answer.size()));
  const std::string_view rgba = std::string_view(answer).substr(std::min(sizeof head, answer.size()));
  const auto fits = [](int side) { return side > 0 && side <= kMostPixelsPerSide; };
  // A decoder that the file has taken over may answer anything.
  if (!fits(head.width) || !fits(head.height) ||
      rgba.size() != std::size_t{4} * static_cast<std::size_t>(head.width) * static_cast<std::size_t>(head.height))
    throw InputError(name_for_errors, "", "cannot be decoded as a picture: the decoder gave no picture");
  Image image;
  image.width = head.width;
  image.height = head.height;
  image.rgba.assign(rgba.begin(), rgba.end());
  if (stored != nullptr) *stored = head.stored;
  return image;
}

}  // namespace anigen::io
