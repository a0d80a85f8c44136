#include "anigen/io/onnx.h"

#include <algorithm>
#include <cstring>
#include <fstream>
#include <map>
#include <set>
#include <string_view>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/io/arrays/ndarray.h"

namespace anigen::io {

namespace {

// Field numbers and element types of onnx.proto3.
constexpr std::uint64_t kModelGraph = 7;
constexpr std::uint64_t kGraphNode = 1, kGraphInitializer = 5, kGraphInput = 11, kGraphOutput = 12,
                        kGraphValueInfo = 13;
constexpr std::uint64_t kNodeInput = 1, kNodeOutput = 2, kNodeType = 4, kNodeAttribute = 5;
constexpr std::uint64_t kAttributeName = 1, kAttributeInt = 3, kAttributeTensor = 5, kAttributeGraph = 6;
constexpr std::uint64_t kTensorType = 2, kTensorInts = 5, kTensorRaw = 9, kTensorLocation = 14;
constexpr std::uint64_t kValueType = 2, kTypeTensor = 1, kTensorTypeElement = 1;
constexpr std::uint64_t kFloat = 1, kHalf = 10, kDouble = 11;
constexpr std::uint64_t kLongestName = 1 << 16;

// --- Signature: read from the file, past its weights ---

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

// GraphProto { 5: initializer { 2: data_type, 8: name }, 11: input, 12: output }
OnnxSignature read_graph(const ProtoMessage& graph) {
  OnnxSignature signature;
  std::set<std::string> stored;
  for_each(graph, 5, [&](const ProtoMessage& tensor) {
    for_each(tensor.message(), 8, [&](ProtoMessage& name) { stored.insert(name.text()); });
    for_each(tensor.message(), 2, [&](const ProtoMessage& type) { signature.half |= type.number() == kHalf; });
  });
  for_each(graph, 11, [&](const ProtoMessage& input) {
    OnnxSignature::Value value = read_value(input.message());
    if (stored.count(value.name) == 0) signature.inputs.push_back(std::move(value));  // old files list weights, too
  });
  for_each(graph, 12, [&](const ProtoMessage& output) { signature.outputs.push_back(read_value(output.message())); });
  return signature;
}

// --- Full precision: from bytes to bytes ---

/// Field of a message of Protocol Buffers.
struct Field {
  std::uint64_t number = 0;
  unsigned wire = 0;        // 0: value; 2: bytes; 1, 5: bytes of 8 and 4
  std::uint64_t value = 0;  // of wire 0
  std::string_view bytes;   // of the others
};

class Parser {
 public:
  Parser(std::string_view bytes, const std::string& name) : bytes_(bytes), name_(name) {}

  std::vector<Field> fields() {
    std::vector<Field> found;
    while (at_ < bytes_.size()) {
      Field field;
      const std::uint64_t key = varint();
      field.number = key >> 3;
      field.wire = static_cast<unsigned>(key & 7);
      switch (field.wire) {
        case 0:
          field.value = varint();
          break;
        case 1:
          field.bytes = take(8);
          break;
        case 2:
          field.bytes = take(varint());
          break;
        case 5:
          field.bytes = take(4);
          break;
        default:
          fail();
      }
      found.push_back(field);
    }
    return found;
  }
  std::uint64_t varint() {
    std::uint64_t value = 0;
    for (unsigned shift = 0; shift < 64; shift += 7) {
      if (at_ >= bytes_.size()) fail();
      const auto byte = static_cast<unsigned char>(bytes_[at_++]);
      value |= static_cast<std::uint64_t>(byte & 0x7F) << shift;
      if ((byte & 0x80) == 0) return value;
    }
    fail();
  }
  bool done() const { return at_ >= bytes_.size(); }

 private:
  std::string_view take(std::uint64_t count) {
    if (count > bytes_.size() - at_) fail();
    const std::string_view taken = bytes_.substr(at_, static_cast<std::size_t>(count));
    at_ += static_cast<std::size_t>(count);
    return taken;
  }
  [[noreturn]] void fail() const { throw InputError(name_, "", "is not an ONNX network, or damaged"); }

  std::string_view bytes_;
  std::size_t at_ = 0;
  const std::string& name_;
};

std::vector<Field> fields_of(std::string_view bytes, const std::string& name) { return Parser(bytes, name).fields(); }

void append_varint(std::string& to, std::uint64_t value) {
  for (; value >= 0x80; value >>= 7) to += static_cast<char>(value | 0x80);
  to += static_cast<char>(value);
}

void append_number(std::string& to, std::uint64_t field, std::uint64_t value) {
  append_varint(to, field << 3);
  append_varint(to, value);
}

void append_bytes(std::string& to, std::uint64_t field, std::string_view bytes) {
  append_varint(to, field << 3 | 2);
  append_varint(to, bytes.size());
  to += bytes;
}

void append(std::string& to, const Field& field) {
  if (field.wire == 0) return append_number(to, field.number, field.value);
  if (field.wire == 2) return append_bytes(to, field.number, field.bytes);
  append_varint(to, field.number << 3 | field.wire);
  to += field.bytes;
}

std::uint64_t number_of(const std::vector<Field>& fields, std::uint64_t number) {
  for (const Field& field : fields) {
    if (field.number == number && field.wire == 0) return field.value;
  }
  return 0;
}

std::string_view text_of(const std::vector<Field>& fields, std::uint64_t number) {
  for (const Field& field : fields) {
    if (field.number == number && field.wire == 2) return field.bytes;
  }
  return {};
}

void append_float(std::string& to, std::uint16_t half) {
  const float value = half_to_float(half);
  char bytes[sizeof value];
  std::memcpy(bytes, &value, sizeof value);
  to.append(bytes, sizeof value);
}

/// TensorProto: values of 16-bit floats, which stand in raw_data or, a number each, in int32_data.
std::string widened_tensor(std::string_view bytes, const std::string& name) {
  const std::vector<Field> fields = fields_of(bytes, name);
  if (number_of(fields, kTensorLocation) != 0)
    throw InputError(name, "", "keeps weights in other files, which is not supported");
  if (number_of(fields, kTensorType) != kHalf) return std::string(bytes);
  std::string tensor, values;
  for (const Field& field : fields) {
    if (field.number == kTensorType) {
      append_number(tensor, kTensorType, kFloat);
    } else if (field.number == kTensorRaw) {
      if (field.bytes.size() % sizeof(std::uint16_t) != 0) throw InputError(name, "", "holds half of a 16-bit float");
      for (std::size_t i = 0; i < field.bytes.size(); i += sizeof(std::uint16_t)) {
        std::uint16_t half = 0;
        std::memcpy(&half, field.bytes.data() + i, sizeof half);
        append_float(values, half);
      }
    } else if (field.number == kTensorInts && field.wire == 2) {
      for (Parser packed(field.bytes, name); !packed.done();)
        append_float(values, static_cast<std::uint16_t>(packed.varint()));
    } else if (field.number == kTensorInts) {
      append_float(values, static_cast<std::uint16_t>(field.value));
    } else {
      append(tensor, field);
    }
  }
  append_bytes(tensor, kTensorRaw, values);
  return tensor;
}

/// ValueInfoProto { 2: TypeProto { 1: Tensor { 1: elem_type } } } of an input or output.
std::string widened_value(std::string_view bytes, const std::string& name) {
  std::string value;
  for (const Field& field : fields_of(bytes, name)) {
    if (field.number != kValueType || field.wire != 2) {
      append(value, field);
      continue;
    }
    std::string type;
    for (const Field& kind : fields_of(field.bytes, name)) {
      if (kind.number != kTypeTensor || kind.wire != 2) {
        append(type, kind);
        continue;
      }
      std::string tensor;
      for (Field part : fields_of(kind.bytes, name)) {
        if (part.number == kTensorTypeElement && part.value == kHalf) part.value = kFloat;
        append(tensor, part);
      }
      append_bytes(type, kTypeTensor, tensor);
    }
    append_bytes(value, kValueType, type);
  }
  return value;
}

struct Node {
  std::string bytes;
  std::vector<std::string> inputs, outputs;
};

/// NodeProto with widened constants; a cast to a float type becomes an identity.
Node widened_node(std::string_view bytes, const std::string& name) {
  const std::vector<Field> fields = fields_of(bytes, name);
  const std::string_view type = text_of(fields, kNodeType);
  bool to_float = false;
  Node node;
  std::string attributes;
  for (const Field& field : fields) {
    if (field.number == kNodeInput) node.inputs.emplace_back(field.bytes);
    if (field.number == kNodeOutput) node.outputs.emplace_back(field.bytes);
    if (field.number != kNodeAttribute) continue;
    std::string attribute;
    for (const Field& part : fields_of(field.bytes, name)) {
      if (part.number == kAttributeGraph)
        throw InputError(name, "", "holds a graph inside a node, which is not supported");
      if (part.number == kAttributeTensor) {
        append_bytes(attribute, kAttributeTensor, widened_tensor(part.bytes, name));
      } else {
        append(attribute, part);
      }
    }
    const std::vector<Field> parts = fields_of(field.bytes, name);
    const std::uint64_t to = number_of(parts, kAttributeInt);
    if (type == "Cast" && text_of(parts, kAttributeName) == "to")
      to_float = to == kFloat || to == kHalf || to == kDouble;
    append_bytes(attributes, kNodeAttribute, attribute);
  }
  for (const Field& field : fields) {
    if (field.number == kNodeAttribute) continue;
    if (field.number == kNodeType && to_float) {
      append_bytes(node.bytes, kNodeType, "Identity");
    } else {
      append(node.bytes, field);
    }
  }
  if (!to_float) node.bytes += attributes;
  return node;
}

/// Order of nodes in which each follows those whose outputs it reads; of those that may come next, the first of the
/// file.
std::vector<std::size_t> sorted(const std::vector<Node>& nodes, const std::string& name) {
  std::map<std::string, std::size_t> maker;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    for (const std::string& output : nodes[i].outputs) maker[output] = i;
  }
  std::vector<std::size_t> missing(nodes.size(), 0);
  std::vector<std::vector<std::size_t>> readers(nodes.size());
  std::set<std::size_t> ready;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    for (const std::string& input : nodes[i].inputs) {
      const auto made = maker.find(input);
      if (input.empty() || made == maker.end()) continue;
      ++missing[i];
      readers[made->second].push_back(i);
    }
    if (missing[i] == 0) ready.insert(i);
  }
  std::vector<std::size_t> order;
  while (!ready.empty()) {
    const std::size_t i = *ready.begin();
    ready.erase(ready.begin());
    order.push_back(i);
    for (const std::size_t reader : readers[i]) {
      if (--missing[reader] == 0) ready.insert(reader);
    }
  }
  if (order.size() != nodes.size()) throw InputError(name, "", "has nodes that wait for each other");
  return order;
}

std::string widened_graph(std::string_view bytes, const std::string& name) {
  std::string graph;
  std::vector<Node> nodes;
  for (const Field& field : fields_of(bytes, name)) {
    switch (field.number) {
      case kGraphNode:
        nodes.push_back(widened_node(field.bytes, name));
        break;
      case kGraphInitializer:
        append_bytes(graph, kGraphInitializer, widened_tensor(field.bytes, name));
        break;
      case kGraphInput:
      case kGraphOutput:
        append_bytes(graph, field.number, widened_value(field.bytes, name));
        break;
      case kGraphValueInfo:  // types of what lies between, which are derived again
        break;
      default:
        append(graph, field);
    }
  }
  for (const std::size_t i : sorted(nodes, name)) append_bytes(graph, kGraphNode, nodes[i].bytes);
  return graph;
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

std::string onnx_in_full_precision(const std::string& model, const std::string& name) {
  std::string result;
  bool found = false;
  for (const Field& field : fields_of(model, name)) {
    if (field.number == kModelGraph && field.wire == 2) {
      append_bytes(result, kModelGraph, widened_graph(field.bytes, name));
      found = true;
    } else {
      append(result, field);
    }
  }
  if (!found) throw InputError(name, "", "is not an ONNX network: it holds no graph");
  return result;
}

}  // namespace anigen::io
