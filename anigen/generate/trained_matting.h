#pragma once
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "anigen/io/image.h"

namespace anigen::generate {

/// A matting network of ours (vision/matting.h) that anigen-train has trained, on the CPU.
class TrainedMatting {
 public:
  /// @param run its folder, of which the newest averaged weights are taken
  /// @throws InputError when the run holds no such model, or its weights do not fit
  explicit TrainedMatting(const std::filesystem::path& run);
  ~TrainedMatting();
  TrainedMatting(const TrainedMatting&) = delete;
  TrainedMatting& operator=(const TrainedMatting&) = delete;

  /// The picture is brought into the network's square (Lanczos), whose margins repeat its edge; alpha is interpolated
  /// bilinearly back to its size. Parts below a fiftieth of the largest one are dropped.
  /// @param image alpha is ignored @param name of the picture, for messages @return [H · W] alpha 0 … 255
  /// @throws InputError when no pixel is more object than background
  std::vector<std::uint8_t> mask(const io::Image& image, const std::string& name);

 private:
  struct Loaded;
  std::unique_ptr<Loaded> loaded_;
};

}  // namespace anigen::generate
