#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "anigen/core/error.h"

namespace anigen {

/// JSON that keeps the order of keys, since configs list models in the order that optimisers see them.
using Json = nlohmann::ordered_json;

/// Limits of a text to parse: recursion overflows the stack, and a parsed value takes 50 bytes and more where
/// its text took two.
struct JsonLimits {
  std::size_t depth = 256;
  std::size_t values = 10'000'000;
};

/// Parses text after checking it against the limits.
/// @param file only for the message @throws InputError with the byte offset
Json parse_json(std::string_view text, const std::string& file, const JsonLimits& limits = {});

/// A key as RFC 6901 writes it inside a JSON pointer: '~' becomes "~0" and '/' becomes "~1".
std::string escaped_for_pointer(const std::string& key);

Json read_json(const std::filesystem::path& path, const JsonLimits& limits = {});

/// Reads a JSON config. `"extends": "other.json"` (or a list of files, later ones winning), relative to the file
/// that says it, is read first and then overlaid by merge_config(); chains may be 16 files long.
/// @return the merged config without "extends" @throws InputError for an unreadable file, a cycle, a longer chain,
/// or a file whose top level is not an object
Json load_config(const std::filesystem::path& path);

/// Overlays `changes` on `base`: objects merge key by key, everything else is replaced. An object that carries
/// another "name" than the one below it replaces that one whole, since the arguments of one model, dataset,
/// trainer or schedule mean nothing to another.
void merge_config(Json& base, const Json& changes);

/// Applies one `path.to.key=value` (numbers index into lists). The value is parsed as JSON and, when that fails,
/// taken as a string. Missing objects on the way are created: whether a new key means anything is for the reader
/// of the config to say, which reports unknown keys.
/// @throws InputError when there is no '=', the path is empty or passes through something that is not an object
void apply_override(Json& config, const std::string& assignment);
void apply_overrides(Json& config, const std::vector<std::string>& assignments);

/// Two-space indented text with a final newline; written atomically.
void write_config(const std::filesystem::path& path, const Json& config);

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

  /// Present; does not count as asking for it.
  bool has(const std::string& key) const { return object_->contains(key); }

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
  T value(const std::string& key, const T& fallback, const char* what, Check check, Json schema);
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

/// "did you mean 'depth'?" when one of the words is near, otherwise all of them behind `all`.
std::string suggestion(const std::string& word, const std::vector<std::string>& words,
                       const std::string& all = "known are ");

/// Record of what readers of configs ask for on this thread while it lives: the keys with their types, bounds, words
/// and defaults, as a JSON Schema of the file, and a config written out in full.
class ConfigRecord {
 public:
  ConfigRecord();
  ~ConfigRecord();
  ConfigRecord(const ConfigRecord&) = delete;
  ConfigRecord& operator=(const ConfigRecord&) = delete;

  /// JSON Schema of the file's top level. A key that is read in a form of its own may be anything.
  const Json& schema() const { return schema_; }
  /// The config with the defaults of all keys that were read and that it leaves out.
  Json completed(const Json& config) const;

  /// Schema of the value at a pointer, made where there is none yet: for ConfigReader.
  Json& node(const std::string& pointer);
  /// The innermost record of this thread; nullptr without one.
  static ConfigRecord* current();

 private:
  Json schema_ = {{"type", "object"}};
  ConfigRecord* before_;
};

}  // namespace anigen

/// JSON of a record by the names of its members, in this order, and back. Json::get throws Json::exception for a key
/// that is missing or of another type.
#define ANIGEN_JSON_RECORD(Type, ...)                                          \
  inline void to_json(Json& nlohmann_json_j, const Type& nlohmann_json_t) {    \
    NLOHMANN_JSON_EXPAND(NLOHMANN_JSON_PASTE(NLOHMANN_JSON_TO, __VA_ARGS__))   \
  }                                                                            \
  inline void from_json(const Json& nlohmann_json_j, Type& nlohmann_json_t) {  \
    NLOHMANN_JSON_EXPAND(NLOHMANN_JSON_PASTE(NLOHMANN_JSON_FROM, __VA_ARGS__)) \
  }
