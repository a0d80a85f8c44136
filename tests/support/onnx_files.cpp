#include "tests/support/onnx_files.h"

#include <cstring>

#include "anigen/io/arrays/ndarray.h"

namespace anigen::test {
namespace {

// ONNX's numbers for 32-bit and 16-bit floats, for attributes that are a number or a list of them
constexpr std::int64_t kFloat = 1, kHalf = 10, kInteger = 2, kIntegers = 7;

std::string varint(std::uint64_t value) {
  std::string bytes;
  for (; value >= 0x80; value >>= 7) bytes += static_cast<char>(value | 0x80);
  return bytes + static_cast<char>(value);
}

std::string number_field(int field, std::int64_t value) {
  return varint(static_cast<std::uint64_t>(field) << 3) + varint(static_cast<std::uint64_t>(value));
}

std::string bytes_field(int field, const std::string& bytes) {
  return varint(static_cast<std::uint64_t>(field) << 3 | 2) + varint(bytes.size()) + bytes;
}

std::string node_message(const OnnxNode& node) {
  std::string message;
  for (const std::string& input : node.inputs) message += bytes_field(1, input);
  for (const std::string& output : node.outputs) message += bytes_field(2, output);
  message += bytes_field(3, node.type + " for " + node.outputs.front()) + bytes_field(4, node.type);
  if (node.cast_to != 0) {
    message += bytes_field(5, bytes_field(1, "to") + number_field(3, node.cast_to) + number_field(20, kInteger));
  }
  if (node.kernel_shape.empty()) return message;
  std::string attribute = bytes_field(1, "kernel_shape");
  for (const std::int64_t size : node.kernel_shape) attribute += number_field(8, size);
  return message + bytes_field(5, attribute + number_field(20, kIntegers));
}

std::string weights_message(const OnnxTensor& tensor) {
  std::string message;
  for (const std::int64_t size : tensor.shape) message += number_field(1, size);
  std::string raw(tensor.values.size() * sizeof(float), '\0');
  std::memcpy(raw.data(), tensor.values.data(), raw.size());
  if (tensor.half) {
    raw.clear();
    for (const float value : tensor.values) {
      const std::uint16_t half = io::float_to_half(value);
      raw.append(reinterpret_cast<const char*>(&half), sizeof half);
    }
  }
  return message + number_field(2, tensor.half ? kHalf : kFloat) + bytes_field(8, tensor.name) + bytes_field(9, raw);
}

std::string value_message(const OnnxTensor& tensor) {
  std::string shape;
  for (const std::int64_t size : tensor.shape)
    shape += bytes_field(1, size > 0 ? number_field(1, size) : bytes_field(2, "open"));
  const std::string type = number_field(1, tensor.half ? kHalf : kFloat) + bytes_field(2, shape);
  return bytes_field(1, tensor.name) + bytes_field(2, bytes_field(1, type));
}

}  // namespace

std::string onnx_bytes(const OnnxFile& file) {
  std::string graph;
  for (const OnnxNode& node : file.nodes) graph += bytes_field(1, node_message(node));
  graph += bytes_field(2, "graph");
  for (const OnnxTensor& tensor : file.weights) graph += bytes_field(5, weights_message(tensor));
  for (const OnnxTensor& tensor : file.inputs) graph += bytes_field(11, value_message(tensor));
  for (const OnnxTensor& tensor : file.outputs) graph += bytes_field(12, value_message(tensor));
  const std::string operators = bytes_field(1, "") + number_field(2, 11);
  return number_field(1, 7) + bytes_field(7, graph) + bytes_field(8, operators);
}

OnnxFile channel_sum_network(std::int64_t side, const std::vector<float>& weights) {
  OnnxFile file;
  file.nodes = {{"Conv", {"picture", "weights"}, {"mask"}, {1, 1}}};
  file.weights = {{"weights", {1, 3, 1, 1}, weights}};
  file.inputs = {{"picture", {1, 3, side, side}, {}}};
  file.outputs = {{"mask", {1, 1, side, side}, {}}};
  return file;
}

}  // namespace anigen::test
