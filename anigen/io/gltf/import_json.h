#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "anigen/core/json.h"

namespace anigen::io::gltf_import {

/// A value of a glTF's JSON together with where it is, so that every wrong type, index or number becomes an
/// InputError with a JSON pointer. Refers to the JSON and the file name; both must outlive it.
class JsonPlace {
 public:
  JsonPlace(const Json& value, const std::string& file, std::string pointer = "");

  const Json& value() const { return *value_; }
  const std::string& file() const { return *file_; }
  const std::string& pointer() const { return pointer_; }
  [[noreturn]] void fail(const std::string& problem) const;
  [[noreturn]] void not_supported(const std::string& feature) const;

  /// Members of an object; find() gives nothing when it is absent. @throws InputError when this is no object
  std::optional<JsonPlace> find(const char* key) const;
  JsonPlace at(const char* key) const;
  std::vector<std::string> keys() const;

  /// Elements of an array. @throws InputError when this is no array
  std::size_t size() const;
  JsonPlace operator[](std::size_t index) const;

  /// Scalars; a float with an integral value counts as an integer, as JSON knows only numbers.
  std::uint64_t integer(std::uint64_t low, std::uint64_t high) const;
  double number() const;  ///< finite
  std::string string() const;
  bool boolean() const;
  /// Exactly `count` finite numbers.
  std::vector<double> numbers(std::size_t count) const;

  /// Optional members with their default.
  std::uint64_t integer_or(const char* key, std::uint64_t fallback, std::uint64_t high) const;
  std::string string_or(const char* key, const std::string& fallback) const;
  bool boolean_or(const char* key, bool fallback) const;
  /// An optional index into an array of `count` entries; -1 when absent.
  int index_or_none(const char* key, std::size_t count, const char* what) const;
  int index(const char* key, std::size_t count, const char* what) const;
  /// The same for the value itself.
  int as_index(std::size_t count, const char* what) const;
  /// Length of an optional array member; 0 when absent.
  std::size_t size_of(const char* key) const;

 private:
  const Json* value_;
  const std::string* file_;
  std::string pointer_;
};

}  // namespace anigen::io::gltf_import
