#pragma once
#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <vector>

#include "anigen/io/image.h"

namespace anigen::pipeline {

/// A network that separates an object from its background, and how it wants its pictures. The defaults are
/// BiRefNet's (reference flows-and-pipeline.md, 5.2, "rembg/BiRefNet details"); no weights come with this project.
struct MattingOptions {
  std::filesystem::path network;  ///< ONNX; empty: none
  int size = 1024;                ///< side of its input, where the file leaves it open
  std::array<double, 3> mean{0.485, 0.456, 0.406};
  std::array<double, 3> deviation{0.229, 0.224, 0.225};
};

/// Runs such a network through OpenCV: one input [1, 3, H, W]; of its outputs the first one, [1, 1, H', W'], is the
/// mask, as logits, or as probabilities when all of them lie in [0, 1].
class MattingNetwork {
 public:
  /// @throws InputError when the file is not ONNX, has another signature, or holds an operator that OpenCV lacks
  explicit MattingNetwork(const MattingOptions& options);
  ~MattingNetwork();
  MattingNetwork(const MattingNetwork&) = delete;
  MattingNetwork& operator=(const MattingNetwork&) = delete;

  /// The picture is resized to the input's size whatever its aspect (Lanczos), divided by its largest value,
  /// normalised; the mask is stretched to [0, 1], rounded down to bytes and resized back (Lanczos).
  /// @param image alpha is ignored @return [H · W] alpha 0 … 255
  /// @throws InputError when the network cannot run, or sees the same everywhere
  std::vector<std::uint8_t> mask(const io::Image& image);

 private:
  struct Loaded;
  std::unique_ptr<Loaded> loaded_;
};

}  // namespace anigen::pipeline
