#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace anigen::io {

/// Inputs and outputs of a network in an ONNX file.
struct OnnxSignature {
  struct Value {
    std::string name;
    std::vector<std::int64_t> shape;  ///< 0 where the file leaves a size open
  };
  std::vector<Value> inputs;   ///< without those that have stored weights
  std::vector<Value> outputs;  ///< in the order of the file
  bool half = false;           ///< stored weights are 16-bit floats, or some of them
};

/// Reads names and shapes alone; weights are skipped, however large.
/// @throws InputError when the file cannot be read or is not ONNX
OnnxSignature read_onnx_signature(const std::filesystem::path& path);

/// An ONNX network in the form that OpenCV 4.6 reads: weights and constants of 16-bit floats become 32-bit ones, casts
/// between float types become identities, inputs and outputs are declared as 32-bit floats, and nodes stand in an order
/// in which each follows those it needs. Everything else keeps its bytes.
/// @param model bytes of a ModelProto (onnx.proto3 of ONNX 1.x) @param name of the file, for messages
/// @throws InputError when the bytes are no ONNX network, its nodes depend on each other in a ring, or it keeps weights
/// in other files
std::string onnx_in_full_precision(const std::string& model, const std::string& name);

}  // namespace anigen::io
