#pragma once
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace anigen::train {

/// CRC-32C (Castagnoli polynomial, reflected).
std::uint32_t crc32c(std::string_view bytes);
/// The checksum TFRecord files store: rotated right by 15 bits plus 0xA282EAD8.
std::uint32_t masked_crc32c(std::string_view bytes);

/// Appends scalars and pictures to a TensorBoard event file: TFRecord frames around protobuf messages of type
/// tensorflow.Event (event.proto and summary.proto of TensorFlow), encoded by hand. A resumed run writes a file of
/// its own that starts with a session mark, upon which TensorBoard forgets what was logged from that step on.
class TensorBoardWriter {
 public:
  /// Creates `<folder>/events.out.tfevents.<seconds>.<host>.<process>`. @throws Error when that fails
  /// @param first_step steps from here on replace older entries
  TensorBoardWriter(const std::filesystem::path& folder, std::int64_t first_step);
  ~TensorBoardWriter();
  TensorBoardWriter(const TensorBoardWriter&) = delete;
  TensorBoardWriter& operator=(const TensorBoardWriter&) = delete;

  void scalar(const std::string& tag, double value, std::int64_t step);
  /// @param png an encoded RGBA picture of that size
  void image(const std::string& tag, const std::vector<std::uint8_t>& png, int width, int height, std::int64_t step);
  void flush();
  const std::filesystem::path& path() const { return path_; }

 private:
  void write_event(std::int64_t step, const std::string& payload);

  std::filesystem::path path_;
  std::FILE* file_ = nullptr;
};

}  // namespace anigen::train
