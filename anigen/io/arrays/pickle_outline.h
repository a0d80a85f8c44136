#pragma once
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "anigen/io/arrays/pickle.h"

namespace anigen::io::pickle {

/// A pickled object array, or list in one, of dictionaries, known by where each of them lies: so that one can be read
/// without the others. Of the numbers nothing is kept; of everything else the names, types and short texts to
/// which later parts of a pickle refer back.
class Outline {
 public:
  struct Dict {
    std::uint64_t first = 0, bytes = 0;  ///< its stretch of the pickle
    std::size_t memo_entries = 0;        ///< made before it
    std::string name;                    ///< its text under the key asked for; empty: it has none
  };

  /// Reads all of it once, in pieces.
  /// @param name_key of the texts that become names
  /// @return null when it holds anything but dictionaries, or when a dictionary shares lists or arrays with another:
  /// then only load() of the whole reads it
  /// @throws InputError and NotSupportedError as load()
  static std::unique_ptr<const Outline> read(const ByteSource& bytes, const Source& source, std::string_view name_key);

  const std::vector<Dict>& dicts() const { return dicts_; }
  /// The array's shape.
  const std::vector<std::int64_t>& sizes() const { return sizes_; }

  /// One dictionary with everything in it. Its texts may point into this outline. Several threads may call at once.
  /// @throws as load()
  Document load(const ByteSource& bytes, const Source& source, std::size_t index) const;

 private:
  friend class OutlineMachine;
  friend class StretchMachine;
  Value* kept(const Value& value);

  std::vector<Dict> dicts_;
  std::vector<std::int64_t> sizes_;
  std::deque<Value> leaves_;
  std::deque<std::string> texts_;
  std::unordered_map<std::string_view, Value*> strings_, byte_strings_;
  std::unordered_map<std::uint64_t, Value*> memo_;
};

}  // namespace anigen::io::pickle
