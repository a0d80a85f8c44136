#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace anigen::pipeline {

/// What a network in an ONNX file takes and gives.
struct OnnxSignature {
  struct Value {
    std::string name;
    std::vector<std::int64_t> shape;  ///< 0 where the file leaves a size open
  };
  std::vector<Value> inputs;   ///< without those that have stored weights
  std::vector<Value> outputs;  ///< in the order of the file
};

/// Reads names and shapes alone; weights are skipped, however large.
/// @throws InputError when the file cannot be read or is not ONNX
OnnxSignature read_onnx_signature(const std::filesystem::path& path);

}  // namespace anigen::pipeline
