#pragma once
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include "anigen/core/config.h"
#include "anigen/io/arrays/npy.h"
#include "anigen/io/arrays/pickle.h"

namespace anigen::io::pickle {

/// Reads instructions and their arguments off the bytes of a pickle; every failure names the byte of the instruction.
class Scanner {
 public:
  Scanner(std::string_view input, const Source& source) : input_(input), source_(source) {}

  unsigned char next_instruction();
  std::uint64_t number(std::size_t size);       ///< little-endian, 1 to 8 bytes
  std::string_view bytes(std::uint64_t count);  ///< the next bytes, not copied
  std::string_view line();                      ///< up to the next newline, without it
  double big_endian_double();

  bool parse_decimal(std::string_view line, std::int64_t& integer);  ///< false when it exceeds 64 bits
  double parse_float(std::string_view line);
  std::string unquote(std::string_view line);           ///< a Python string literal with its quotes
  std::string unescape_unicode(std::string_view line);  ///< Python's raw-unicode-escape, to UTF-8
  void check_utf8(std::string_view text);

  std::string place() const;
  [[noreturn]] void fail(const std::string& problem) const;

 private:
  std::uint32_t digits(std::string_view text, std::size_t first, std::size_t count, int base);

  std::string_view input_;
  const Source& source_;
  std::size_t at_ = 0, instruction_ = 0;
};

}  // namespace anigen::io::pickle

namespace anigen::io {

/// Value of a pickle in plain values: None, booleans, numbers and texts, lists and tuples of them, dicts of them by
/// text or integer. Everything else becomes null, an entry of a dict by another kind of key is left out.
/// @throws InputError for cycles and for sharing that explodes
Json plain_json(const pickle::Value& value, const NpyPlace& place);

}  // namespace anigen::io

namespace anigen::io::pickle {

/// The names a pickle may refer to. Storages and torch dtypes carry a Dtype.
enum class Global {
  kOrderedDict,
  kNumpyReconstruct,
  kNumpyScalar,
  kNumpyFromBuffer,
  kNumpyArray,
  kNumpyDtype,
  kCodecsEncode,
  kRebuildTensor,
  kRebuildParameter,
  kTorchSize,
  kTorchDevice,
  kTorchStorage,
  kTorchDtype
};

/// @return false when the name is not on the list. @param dtype of a torch storage
bool find_global(std::string_view module, std::string_view name, Global& global, Dtype& dtype);

/// Meaning of calling an allowed name, or setting the state of what it made, means here.
class Constructors {
 public:
  Constructors(Document& document, const Source& source, std::function<std::string()> place);

  Value* make(Kind kind);
  std::string_view keep(std::string text);

  Value* global(std::string_view module, std::string_view name);
  Value* call(const Value& function, const Value& arguments);  ///< REDUCE and NEWOBJ
  void set_state(Value& object, const Value& state);           ///< BUILD
  Value* persistent(const Value& id);                          ///< BINPERSID

  [[noreturn]] void fail(const std::string& problem) const;
  [[noreturn]] void refuse(const std::string& feature) const;

 private:
  const Value& argument(const Value& arguments, std::size_t index, Kind kind) const;
  std::vector<std::int64_t> sizes(const Value& value) const;
  void spend(std::size_t bytes);
  Value* ordered_dict(const Value& arguments);
  Value* scalar(const Value& dtype, std::string_view raw);
  Value* encode(const Value& arguments);
  Value* tensor(const Value& arguments);
  void fill_array(Value& target, const Value& sizes, const Value& dtype, bool fortran, const Value& data);
  void array_state(Value& array, const Value& state);
  void dtype_state(Value& dtype, const Value& state);

  Document& document_;
  const Source& source_;
  std::function<std::string()> place_;
  std::size_t array_budget_;  // the same bytes object could otherwise be turned into many arrays
};

}  // namespace anigen::io::pickle
