#pragma once
#include <cstdint>
#include <memory>
#include <vector>

#include "anigen/generate/preprocess.h"
#include "anigen/io/image.h"

namespace anigen::generate {

/// Runs a matting network of an ONNX file (MattingOptions) through OpenCV, in 32-bit floats whatever it stores: one
/// input [1, 3, H, W]; of its outputs the first one, [1, 1, H', W'], is the mask, as logits, or as probabilities when
/// all of them lie in [0, 1].
class MattingNetwork {
 public:
  /// @throws InputError when the file is not ONNX, has another signature, or holds an operator that OpenCV lacks;
  /// NotSupportedError in a build without OpenCV
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

}  // namespace anigen::generate
