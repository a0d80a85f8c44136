#pragma once
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "anigen/io/arrays/ndarray.h"
#include "anigen/io/arrays/npy.h"

namespace anigen::io::pickle {

/// A deliberately small pickle machine: protocols 0 to 5 as numpy and torch.save use them. It builds values and never
/// runs anything: the only names a pickle may refer to are those in pickle_constructors.cpp; all others are refused by
/// name.
enum class Kind {
  kNone,
  kBool,         ///< integer 0 or 1
  kInt,          ///< integer
  kFloat,        ///< real
  kString,       ///< text, valid UTF-8
  kBytes,        ///< text
  kList,         ///< items
  kTuple,        ///< items
  kSet,          ///< items
  kDict,         ///< items: key, value, key, value, …
  kArray,        ///< array: a numeric numpy array
  kObjectArray,  ///< items in row-major order, sizes: a numpy array of objects or text
  kDtype,        ///< element: a numpy dtype
  kGlobal,       ///< global: one of the allowed names, not called
  kStorage,      ///< text: key of a torch storage; integer: its element count; element.dtype
  kTensor,       ///< items[0]: storage; integer: offset; sizes, strides: a view into it, in elements
  kOpaque        ///< text: something known that holds no number we keep (torch.device, integers beyond 64 bits)
};

struct Value {
  Kind kind = Kind::kNone;
  int global = -1;
  std::int64_t integer = 0;
  double real = 0;
  std::string_view text;
  std::vector<Value*> items;
  std::vector<std::int64_t> sizes, strides;
  std::unique_ptr<NdArray> array;
  NpyElement element;
};

const char* name_of(Kind kind);  ///< "list", "dict", …

/// Owns all values of one pickle. Values point at each other freely, also in cycles: whoever walks them bounds depth
/// and number of visits.
class Document {
 public:
  Document() = default;
  explicit Document(std::string input) : input_(std::make_unique<const std::string>(std::move(input))) {}
  Document(Document&&) = default;
  Document& operator=(Document&&) = default;

  const Value& root() const { return *root_; }

  /// Number of values and of kept texts: forget() goes back to it.
  std::pair<std::size_t, std::size_t> extent() const { return {values_.size(), texts_.size()}; }
  /// Drops all values and texts that were made since. Nothing may point at them any more.
  void forget(const std::pair<std::size_t, std::size_t>& since) {
    while (values_.size() > since.first) values_.pop_back();
    while (texts_.size() > since.second) texts_.pop_back();
  }

 private:
  friend class Machine;
  friend class Constructors;
  std::unique_ptr<const std::string> input_;  // texts point into it; behind a pointer, so that moves keep it in place
  std::deque<std::string> texts_;             // decoded texts that differ from the input
  std::deque<Value> values_;
  const Value* root_ = nullptr;
};

struct Source {
  std::string file, member;      ///< for messages
  std::uint64_t first_byte = 0;  ///< where the pickle begins in the member
  bool torch_storages = false;   ///< persistent ids are torch storages, else refused
  bool outline = false;          ///< numbers and text of arrays, and long bytes objects, are passed over
};

/// A pickle that is read piece by piece. May be read by several threads at once.
class ByteSource {
 public:
  virtual ~ByteSource() = default;
  virtual std::uint64_t size() const = 0;
  /// Bytes [offset, offset + bytes), which are there. @throws InputError when they cannot be read
  virtual void read(std::uint64_t offset, char* to, std::size_t bytes) const = 0;
};

/// Runs the pickle. Memory is bounded by a small multiple of its size.
/// @throws InputError with the byte of the instruction when it is damaged, truncated or exceeds limits,
/// NotSupportedError naming what it asks for otherwise
Document load(std::string bytes, const Source& source);

}  // namespace anigen::io::pickle
