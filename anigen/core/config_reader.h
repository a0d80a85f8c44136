#pragma once
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/json.h"

namespace anigen {

/// Reads one object of a config with typed getters and remembers which keys were asked for, so that finish() can
/// refuse the others by name. Every error carries the file and the JSON pointer of the value.
///
///   ConfigReader reader(json, "configs/tiny/skin_ae.json", "/models/model/args");
///   options.depth = reader.integer("depth", 4, 1, 64);
///   ...
///   reader.finish();   // "/models/model/args: unknown key 'detph'; did you mean 'depth'?"
class ConfigReader {
 public:
  /// @param object must outlive the reader @param file only for messages @param pointer where the object is in the file
  /// @throws InputError when it is not an object
  ConfigReader(const Json& object, std::string file, std::string pointer = "");

  bool has(const std::string& key) const;  ///< present; does not count as asking for it

  /// Getters with a default for an absent key. @throws InputError on another type or a value out of range
  std::int64_t integer(const std::string& key, std::int64_t fallback,
                       std::int64_t lowest = std::numeric_limits<std::int64_t>::min(),
                       std::int64_t highest = std::numeric_limits<std::int64_t>::max());
  double number(const std::string& key, double fallback, double lowest = std::numeric_limits<double>::lowest(),
                double highest = std::numeric_limits<double>::max());
  bool boolean(const std::string& key, bool fallback);
  std::string text(const std::string& key, const std::string& fallback);
  /// One of a few words. @throws InputError listing them
  std::string choice(const std::string& key, const std::string& fallback, const std::vector<std::string>& words);
  std::vector<std::int64_t> integers(const std::string& key, const std::vector<std::int64_t>& fallback);
  std::vector<double> numbers(const std::string& key, const std::vector<double>& fallback);
  std::vector<std::string> texts(const std::string& key, const std::vector<std::string>& fallback);

  /// A nested object; an absent key reads as an empty object. Call finish() on it too.
  ConfigReader object(const std::string& key);
  /// The value as it is; nullptr when absent.
  const Json* raw(const std::string& key);
  /// @throws InputError when the key is absent; use before a getter
  void require(const std::string& key) const;
  /// Accepts a key that the published configs carry and the published code never reads, warning once.
  void ignore(const std::string& key);

  /// @throws InputError naming the first key nobody asked for and the nearest known one
  void finish() const;
  /// An error about the value of `key` ("" for the object itself), to be thrown by the caller.
  InputError error(const std::string& key, const std::string& problem) const;

  const std::string& file() const { return file_; }
  std::string pointer_to(const std::string& key) const;

 private:
  const Json* find(const std::string& key);
  template <typename T, typename Check>
  std::vector<T> list(const std::string& key, const std::vector<T>& fallback, const char* what, Check check);

  const Json* object_;
  std::string file_, pointer_;
  std::vector<std::string> known_;
};

/// Number of insertions, deletions, substitutions and swaps of neighbours that turn a into b (optimal string
/// alignment distance).
std::size_t edit_distance(const std::string& a, const std::string& b);

/// The word nearest to the given one, or "" when none is near enough to be a likely misspelling.
std::string nearest_word(const std::string& word, const std::vector<std::string>& words);

}  // namespace anigen
