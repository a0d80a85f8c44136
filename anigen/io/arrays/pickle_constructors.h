#pragma once
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include "anigen/io/arrays/npy.h"
#include "anigen/io/arrays/pickle.h"

namespace anigen::io::pickle {

/// Meaning of calling an allowed name, or setting the state of what it made, means here.
class Constructors {
 public:
  /// @param pickle_bytes its size, which bounds what may be made of it
  Constructors(Document& document, const Source& source, std::uint64_t pickle_bytes,
               std::function<std::string()> place);

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
