#pragma once
#include <cstdint>
#include <string>
#include <vector>

namespace anigen::test {

/// Small networks as ONNX files (Protocol Buffers, written by hand), operator set 11.
struct OnnxNode {
  std::string type;
  std::vector<std::string> inputs, outputs;
  std::vector<std::int64_t> kernel_shape;  ///< of a convolution
  std::int64_t cast_to = 0;                ///< element type of a cast
};

struct OnnxTensor {
  std::string name;
  std::vector<std::int64_t> shape;  ///< 0 for a size left open
  std::vector<float> values;        ///< of stored weights; empty for inputs and outputs
  bool half = false;                ///< stored as 16-bit floats, which must be exact
};

struct OnnxFile {
  std::vector<OnnxNode> nodes;
  std::vector<OnnxTensor> weights, inputs, outputs;
};

std::string onnx_bytes(const OnnxFile& file);

/// The first of its outputs is the weighted sum of the three channels, at every pixel.
/// @param side of the input, 0 to leave it open
OnnxFile channel_sum_network(std::int64_t side, const std::vector<float>& weights);

}  // namespace anigen::test
