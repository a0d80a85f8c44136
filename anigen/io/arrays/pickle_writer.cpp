#include "anigen/io/arrays/pickle_writer.h"

#include "anigen/core/error.h"
#include "anigen/io/arrays/npy.h"

namespace anigen::io {

namespace {

std::string little_bytes(std::uint64_t value, int count) {
  std::string text;
  for (int i = 0; i < count; ++i) text += static_cast<char>(value >> (8 * i) & 0xFF);
  return text;
}

/// numpy's two letters of a dtype.
std::string_view code_of(Dtype dtype) {
  switch (dtype) {
    case Dtype::kF16:
      return "f2";
    case Dtype::kF32:
      return "f4";
    case Dtype::kF64:
      return "f8";
    case Dtype::kI8:
      return "i1";
    case Dtype::kI32:
      return "i4";
    case Dtype::kI64:
      return "i8";
    default:
      throw Error(std::string("no pickled array of ") + name_of(dtype));
  }
}

}  // namespace

PickleWriter::PickleWriter(int protocol) { bytes_ = "\x80" + little_bytes(static_cast<std::uint64_t>(protocol), 1); }

void PickleWriter::open_list() { bytes_ += "]("; }
void PickleWriter::open_dict() { bytes_ += "}("; }

void PickleWriter::text(std::string_view value) {
  bytes_ += 'X' + little_bytes(value.size(), 4);
  bytes_ += value;
}

void PickleWriter::integer(std::int64_t value) {
  if (value == static_cast<std::int32_t>(value))
    bytes_ += 'J' + little_bytes(static_cast<std::uint64_t>(value), 4);
  else
    bytes_ += "\x8a\x08" + little_bytes(static_cast<std::uint64_t>(value), 8);
}

void PickleWriter::integers(const std::vector<std::int64_t>& tuple) {
  bytes_ += '(';
  for (const std::int64_t value : tuple) integer(value);
  bytes_ += 't';
}

void PickleWriter::texts(const std::vector<std::string>& list) {
  open_list();
  for (const std::string& item : list) text(item);
  close_list();
}

void PickleWriter::global(std::string_view module, std::string_view name) {
  bytes_ += 'c';
  bytes_ += module;
  bytes_ += '\n';
  bytes_ += name;
  bytes_ += '\n';
}

void PickleWriter::dtype(std::string_view code, std::string_view order) {
  global("numpy", "dtype");
  bytes_ += '(';
  text(code);
  bytes_ += "\x89\x88tR(";  // False, True
  integer(3);
  text(order);
  bytes_ += "NNN";
  for (const int value : {-1, -1, 0}) integer(value);
  bytes_ += "tb";
}

/// A numpy array up to its dtype.
void PickleWriter::numpy_head(const std::vector<std::int64_t>& shape) {
  global("numpy.core.multiarray", "_reconstruct");
  bytes_ += '(';
  global("numpy", "ndarray");
  integers({0});
  bytes_ +=
      "C\x01"
      "btR(";
  integer(1);
  integers(shape);
}

void PickleWriter::array(const NdArray& array) {
  numpy_head(array.shape);
  dtype(code_of(array.dtype), array.dtype == Dtype::kI8 ? "|" : "<");
  bytes_ += '\x89';  // not in Fortran order
  bytes_ += 'B' + little_bytes(array.bytes.size(), 4);
  bytes_.append(reinterpret_cast<const char*>(array.bytes.data()), array.bytes.size());
  bytes_ += "tb";
}

void PickleWriter::open_objects(std::size_t count) {
  numpy_head({static_cast<std::int64_t>(count)});
  dtype("O8", "|");
  bytes_ += '\x89';
  open_list();
}

void PickleWriter::close_objects() {
  close_list();
  bytes_ += "tb";
}

void PickleWriter::tensor(const NdArray& array, const std::string& storage) {
  global("torch._utils", "_rebuild_tensor_v2");
  bytes_ += "((";
  text("storage");
  global("torch", words_of(array.dtype).torch_storage);
  text(storage);
  text("cpu");
  integer(static_cast<std::int64_t>(array.count()));
  bytes_ += "tQ";
  integer(0);
  integers(array.shape);
  std::vector<std::int64_t> strides(array.shape.size(), 1);
  for (std::size_t d = strides.size(); d-- > 1;) strides[d - 1] = strides[d] * array.shape[d];
  integers(strides);
  bytes_ += '\x89';
  global("collections", "OrderedDict");
  bytes_ += ")RtR";
}

}  // namespace anigen::io
