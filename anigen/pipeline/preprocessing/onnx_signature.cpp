#include "anigen/pipeline/preprocessing/onnx_signature.h"

#include <algorithm>
#include <fstream>
#include <set>
#include <utility>

#include "anigen/core/error.h"

namespace anigen::pipeline {
namespace {

constexpr std::uint64_t kLongestName = 1 << 16;

// A message in the encoding of Protocol Buffers, field after field, from a file.
class ProtoMessage {
 public:
  ProtoMessage(std::istream& in, std::uint64_t begin, std::uint64_t end, const std::string& name)
      : in_(in), at_(begin), end_(end), name_(name) {}

  // Moves to the next field; what has not been read of the last one is skipped.
  bool next() {
    at_ = std::max(at_, after_);
    in_.seekg(static_cast<std::streamoff>(at_));
    if (at_ >= end_) return false;
    const std::uint64_t key = varint();
    field_ = key >> 3;
    length_ = 0;
    switch (key & 7) {
      case 0:
        number_ = varint();
        break;
      case 1:
        at_ += 8;
        break;
      case 2:
        length_ = varint();
        if (length_ > end_ - at_) fail();
        break;
      case 5:
        at_ += 4;
        break;
      default:
        fail();
    }
    after_ = at_ + length_;
    if (after_ > end_) fail();
    return true;
  }
  std::uint64_t field() const { return field_; }
  std::uint64_t number() const { return number_; }
  std::string text() {
    if (length_ > kLongestName) fail();
    std::string bytes(static_cast<std::size_t>(length_), '\0');
    if (!in_.read(bytes.data(), static_cast<std::streamsize>(bytes.size()))) fail();
    return bytes;
  }
  ProtoMessage message() const { return {in_, at_, after_, name_}; }

 private:
  [[noreturn]] void fail() const {
    throw InputError(name_, "byte " + std::to_string(at_), "is not an ONNX network, or damaged");
  }
  std::uint64_t varint() {
    std::uint64_t value = 0;
    for (unsigned shift = 0; shift < 64; shift += 7) {
      const int byte = at_ < end_ ? in_.get() : EOF;
      if (byte == EOF) fail();
      ++at_;
      value |= static_cast<std::uint64_t>(byte & 0x7F) << shift;
      if ((byte & 0x80) == 0) return value;
    }
    fail();
  }

  std::istream& in_;
  std::uint64_t at_, end_, after_ = 0;
  std::uint64_t field_ = 0, number_ = 0, length_ = 0;
  const std::string& name_;
};

// Calls `use` with every field of that number, in order.
template <typename Use>
void for_each(ProtoMessage message, std::uint64_t field, const Use& use) {
  while (message.next()) {
    if (message.field() == field) use(message);
  }
}

// ValueInfoProto { 1: name, 2: TypeProto { 1: Tensor { 2: TensorShapeProto { 1: Dimension { 1: size } } } } }
OnnxSignature::Value read_value(const ProtoMessage& info) {
  OnnxSignature::Value value;
  for_each(info, 1, [&](ProtoMessage& name) { value.name = name.text(); });
  for_each(info, 2, [&](const ProtoMessage& type) {
    for_each(type.message(), 1, [&](const ProtoMessage& tensor) {
      for_each(tensor.message(), 2, [&](const ProtoMessage& shape) {
        for_each(shape.message(), 1, [&](const ProtoMessage& dimension) {
          value.shape.push_back(0);
          for_each(dimension.message(), 1,
                   [&](const ProtoMessage& size) { value.shape.back() = static_cast<std::int64_t>(size.number()); });
        });
      });
    });
  });
  return value;
}

// GraphProto { 5: initializer { 8: name }, 11: input, 12: output }
OnnxSignature read_graph(const ProtoMessage& graph) {
  OnnxSignature signature;
  std::set<std::string> stored;
  for_each(graph, 5, [&](const ProtoMessage& tensor) {
    for_each(tensor.message(), 8, [&](ProtoMessage& name) { stored.insert(name.text()); });
  });
  for_each(graph, 11, [&](const ProtoMessage& input) {
    OnnxSignature::Value value = read_value(input.message());
    if (stored.count(value.name) == 0) signature.inputs.push_back(std::move(value));  // old files list weights, too
  });
  for_each(graph, 12, [&](const ProtoMessage& output) { signature.outputs.push_back(read_value(output.message())); });
  return signature;
}

}  // namespace

OnnxSignature read_onnx_signature(const std::filesystem::path& path) {
  const std::string name = path.string();
  std::error_code error;
  const std::uintmax_t bytes = std::filesystem::file_size(path, error);
  std::ifstream in(path, std::ios::binary);
  if (error || !in) throw InputError(name, "", "cannot be read");
  OnnxSignature signature;
  // ModelProto { 7: graph }
  for_each(ProtoMessage(in, 0, bytes, name), 7,
           [&](const ProtoMessage& graph) { signature = read_graph(graph.message()); });
  if (!signature.outputs.empty()) return signature;
  throw InputError(name, "", "is not an ONNX network: it holds no graph");
}

}  // namespace anigen::pipeline
